// PCL's VoxelGrid, and its RANSAC for one plane of what is left, timed: the usual way from the
// points of a depth image to its largest plane.
//
// usage: pcl_voxels LEAF THRESHOLD TRIALS REPEATS FILE...
// FILE holds little-endian float32 x y z. For each file and repeat one line: seconds of processor
// time of VoxelGrid and of RANSAC, points that are left, inliers.
#include <cstdio>
#include <cstdlib>
#include <ctime>

#include <pcl/ModelCoefficients.h>
#include <pcl/PointIndices.h>
#include <pcl/filters/voxel_grid.h>
#include <pcl/point_cloud.h>
#include <pcl/point_types.h>
#include <pcl/sample_consensus/method_types.h>
#include <pcl/sample_consensus/model_types.h>
#include <pcl/segmentation/sac_segmentation.h>

using Cloud = pcl::PointCloud<pcl::PointXYZ>;

static double thread_time() {
  timespec now;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return now.tv_sec + 1e-9 * now.tv_nsec;
}

int main(int argc, char **argv) {
  if (argc < 6) {
    std::fprintf(stderr, "usage: pcl_voxels LEAF THRESHOLD TRIALS REPEATS FILE...\n");
    return 2;
  }
  const float leaf = std::atof(argv[1]);
  for (int i = 5; i < argc; ++i) {
    const Cloud::Ptr cloud(new Cloud), left(new Cloud);
    std::FILE *file = std::fopen(argv[i], "rb");
    if (!file) return 1;
    float p[3];
    while (std::fread(p, sizeof p, 1, file) == 1) cloud->push_back(pcl::PointXYZ(p[0], p[1], p[2]));
    std::fclose(file);
    for (int k = 0; k < std::atoi(argv[4]); ++k) {
      const double begin = thread_time();
      pcl::VoxelGrid<pcl::PointXYZ> grid;
      grid.setLeafSize(leaf, leaf, leaf);
      grid.setInputCloud(cloud);
      grid.filter(*left);
      const double middle = thread_time();
      pcl::SACSegmentation<pcl::PointXYZ> segmentation;
      segmentation.setOptimizeCoefficients(true);
      segmentation.setModelType(pcl::SACMODEL_PLANE);
      segmentation.setMethodType(pcl::SAC_RANSAC);
      segmentation.setMaxIterations(std::atoi(argv[3]));
      segmentation.setDistanceThreshold(std::atof(argv[2]));
      segmentation.setInputCloud(left);
      pcl::ModelCoefficients plane;
      pcl::PointIndices inliers;
      segmentation.segment(inliers, plane);
      std::printf("%.9f %.9f %zu %zu\n", middle - begin, thread_time() - middle, left->size(),
                  inliers.indices.size());
    }
  }
}
