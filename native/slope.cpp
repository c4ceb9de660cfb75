#include <cmath>
#include <vector>

#include "fuse.hpp"
#include "plane_normals.hpp"
#include "threads.hpp"

namespace goc {

void depth_slope(const DepthView& view, int radius, double agree, int fewest, float* slope) {
  const auto fx = static_cast<float>(view.focal[0]), fy = static_cast<float>(view.focal[1]);
  const auto cx = static_cast<float>(view.centre[0]), cy = static_cast<float>(view.centre[1]);
  std::vector<float> normals(static_cast<std::size_t>(view.width) * view.height * 3);
  plane_normals({view.depth, view.width, view.height, fx, fy, cx, cy}, radius, static_cast<float>(agree), fewest,
                normals.data());
  parallel_for(view.height, 16, [&](std::size_t begin, std::size_t end) {
    for (std::size_t y = begin; y < end; ++y)
      for (int x = 0; x < view.width; ++x) {
        const float* n = normals.data() + 3 * (y * view.width + x);
        const float rx = (x + 0.5f - cx) / fx, ry = (y + 0.5f - cy) / fy;
        slope[y * view.width + x] = -(n[0] * rx + n[1] * ry + n[2]) / std::sqrt(rx * rx + ry * ry + 1.0f);
      }
  });
}

}  // namespace goc
