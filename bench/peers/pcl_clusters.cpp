// PCL's Euclidean clusters: the peer that bench_objects.py compares with.
//
// usage: pcl_clusters TOLERANCE MIN_POINTS FILE...
// FILE holds little-endian float32 x y z. For each point of each file one line: the index of its
// cluster in that file, -1 for none; after each file a line with -2 and one with the microseconds of
// processor time.
#include <cstdio>
#include <cstdlib>
#include <vector>

#include <pcl/PointIndices.h>
#include <pcl/search/kdtree.h>
#include <pcl/segmentation/extract_clusters.h>

#include "pcl_cloud.hpp"

int main(int argc, char **argv) {
  if (argc < 4) {
    std::fprintf(stderr, "usage: pcl_clusters TOLERANCE MIN_POINTS FILE...\n");
    return 2;
  }
  for (int i = 3; i < argc; ++i) {
    const Cloud::Ptr cloud = read(argv[i]);
    const double start = thread_time();
    pcl::search::KdTree<pcl::PointXYZ>::Ptr tree(new pcl::search::KdTree<pcl::PointXYZ>);
    tree->setInputCloud(cloud);
    pcl::EuclideanClusterExtraction<pcl::PointXYZ> extraction;
    extraction.setClusterTolerance(std::atof(argv[1]));
    extraction.setMinClusterSize(std::atoi(argv[2]));
    extraction.setSearchMethod(tree);
    extraction.setInputCloud(cloud);
    std::vector<pcl::PointIndices> clusters;
    extraction.extract(clusters);
    const double seconds = thread_time() - start;
    std::vector<int> label(cloud->size(), -1);
    for (size_t k = 0; k < clusters.size(); ++k)
      for (const int index : clusters[k].indices) label[index] = static_cast<int>(k);
    for (const int index : label) std::printf("%d\n", index);
    std::printf("-2\n%.0f\n", 1e6 * seconds);
  }
  return 0;
}
