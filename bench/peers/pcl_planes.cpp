// Plane segmentation by PCL's RANSAC, timed: the peer that bench_planes.py compares with.
//
// usage: pcl_planes THRESHOLD TRIALS REPEATS FILE...
// TRIALS is the most that RANSAC makes; it ends before when it is 99 % sure. PCL draws the same
// numbers in each run, so each repeat begins the cloud with another point: other draws, same points.
// FILE holds little-endian float32 x y z. For each file and repeat one line:
// seconds of processor time, inliers, a b c d, of a x + b y + c z + d = 0.
#include <algorithm>
#include <cstdio>
#include <cstdlib>

#include <pcl/ModelCoefficients.h>
#include <pcl/PointIndices.h>
#include <pcl/sample_consensus/method_types.h>
#include <pcl/sample_consensus/model_types.h>
#include <pcl/segmentation/sac_segmentation.h>

#include "pcl_cloud.hpp"

int main(int argc, char **argv) {
  if (argc < 5) {
    std::fprintf(stderr, "usage: pcl_planes THRESHOLD TRIALS REPEATS FILE...\n");
    return 2;
  }
  const double threshold = std::atof(argv[1]);
  const int trials = std::atoi(argv[2]), repeats = std::atoi(argv[3]);
  for (int i = 4; i < argc; ++i) {
    const Cloud::Ptr cloud = read(argv[i]);
    const auto step = cloud->size() / repeats;
    pcl::ModelCoefficients plane;
    pcl::PointIndices inliers;
    for (int k = 0; k < repeats; ++k) {
      pcl::SACSegmentation<pcl::PointXYZ> segmentation;
      segmentation.setOptimizeCoefficients(true);
      segmentation.setModelType(pcl::SACMODEL_PLANE);
      segmentation.setMethodType(pcl::SAC_RANSAC);
      segmentation.setMaxIterations(trials);
      segmentation.setDistanceThreshold(threshold);
      segmentation.setInputCloud(cloud);
      const double start = thread_time();
      segmentation.segment(inliers, plane);
      std::printf("%.9f %zu", thread_time() - start, inliers.indices.size());
      for (float value : plane.values) std::printf(" %.9g", value);
      std::printf("\n");
      std::rotate(cloud->begin(), cloud->begin() + step, cloud->end());
    }
  }
}
