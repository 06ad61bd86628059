// What the peers of PCL share: clouds out of files of little-endian float32 x y z, and processor time.
#pragma once

#include <cstdio>
#include <cstdlib>
#include <ctime>

#include <pcl/point_cloud.h>
#include <pcl/point_types.h>

using Cloud = pcl::PointCloud<pcl::PointXYZ>;

static double thread_time() {
  timespec now;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return now.tv_sec + 1e-9 * now.tv_nsec;
}

static Cloud::Ptr read(const char *path) {
  Cloud::Ptr cloud(new Cloud);
  std::FILE *file = std::fopen(path, "rb");
  if (!file) {
    std::fprintf(stderr, "cannot open %s\n", path);
    std::exit(1);
  }
  float p[3];
  while (std::fread(p, sizeof p, 1, file) == 1) cloud->push_back(pcl::PointXYZ(p[0], p[1], p[2]));
  std::fclose(file);
  return cloud;
}
