#include <cmath>
#include <vector>

#include "fuse.hpp"
#include "plane_normals.hpp"
#include "threads.hpp"

namespace goc {

void depth_slope(const float* depth, const Lens& lens, int radius, double agree, int fewest, float* slope) {
  std::vector<float> normals(static_cast<std::size_t>(lens.width) * lens.height * 3);
  plane_normals(depth, lens, radius, static_cast<float>(agree), fewest, normals.data());
  parallel_for(lens.height, 16, [&](std::size_t begin, std::size_t end) {
    for (std::size_t y = begin; y < end; ++y)
      for (int x = 0; x < lens.width; ++x) {
        const float* n = normals.data() + 3 * (y * lens.width + x);
        const float rx = (x + 0.5f - lens.cx) / lens.fx, ry = (y + 0.5f - lens.cy) / lens.fy;
        slope[y * lens.width + x] = -(n[0] * rx + n[1] * ry + n[2]) / std::sqrt(rx * rx + ry * ry + 1.0f);
      }
  });
}

}  // namespace goc
