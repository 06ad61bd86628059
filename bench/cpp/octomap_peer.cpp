// OctoMap as users use it, behind a C interface: endpoints only, or with ray casting.
// g++ -O3 -shared -fPIC octomap_peer.cpp -loctomap -loctomath
#include <octomap/octomap.h>

#include <cstdint>

namespace {
octomap::Pointcloud cloud_of(const float* xyz, int n) {
  octomap::Pointcloud cloud;
  cloud.reserve(n);
  for (int i = 0; i < n; ++i) cloud.push_back(xyz[3 * i], xyz[3 * i + 1], xyz[3 * i + 2]);
  return cloud;
}
}  // namespace

extern "C" {

void* octo_new(double resolution) { return new octomap::OcTree(resolution); }
void octo_delete(void* p) { delete static_cast<octomap::OcTree*>(p); }
void octo_clear(void* p) { static_cast<octomap::OcTree*>(p)->clear(); }

void octo_endpoints(void* p, const float* xyz, int n) {
  auto& tree = *static_cast<octomap::OcTree*>(p);
  for (int i = 0; i < n; ++i)
    tree.updateNode(octomap::point3d(xyz[3 * i], xyz[3 * i + 1], xyz[3 * i + 2]), true, true);
  tree.updateInnerOccupancy();
}

void octo_rays(void* p, const float* xyz, int n, double x, double y, double z) {
  static_cast<octomap::OcTree*>(p)->insertPointCloud(cloud_of(xyz, n), octomap::point3d(x, y, z),
                                                     -1.0, false, false);
}

int64_t octo_memory(void* p) { return int64_t(static_cast<octomap::OcTree*>(p)->memoryUsage()); }

// Occupied leaves within a box: x_min x_max y_min y_max z_min z_max.
int64_t octo_occupied(void* p, const double* b) {
  auto& tree = *static_cast<octomap::OcTree*>(p);
  tree.expand();
  int64_t count = 0;
  for (auto it = tree.begin_leafs(), end = tree.end_leafs(); it != end; ++it)
    count += tree.isNodeOccupied(*it) && it.getX() >= b[0] && it.getX() <= b[1] &&
             it.getY() >= b[2] && it.getY() <= b[3] && it.getZ() >= b[4] && it.getZ() <= b[5];
  return count;
}

}  // extern "C"
