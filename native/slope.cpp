#include <algorithm>
#include <cmath>
#include <limits>

#include "fuse.hpp"
#include "threads.hpp"

namespace goc {
namespace {

// Normal equations of q = a u + b v + c, q an inverse depth, over the pixels near one: exact for a plane under perspective.
struct PlaneFit {
  float n = 0, u = 0, v = 0, uu = 0, uv = 0, vv = 0, q = 0, uq = 0, vq = 0;

  void add(float du, float dv, float inverse) {
    n += 1, u += du, v += dv, uu += du * du, uv += du * dv, vv += dv * dv;
    q += inverse, uq += du * inverse, vq += dv * inverse;
  }

  // False where the pixels lie on one line.
  bool solve(float& a, float& b) const {
    const float suu = uu - u * u / n, suv = uv - u * v / n, svv = vv - v * v / n;
    const float suq = uq - u * q / n, svq = vq - v * q / n, det = suu * svv - suv * suv;
    if (det < 1e-3f) return false;
    a = (suq * svv - svq * suv) / det;
    b = (svq * suu - suq * suv) / det;
    return true;
  }
};

}  // namespace

void depth_slope(const DepthView& view, int radius, double agree, int fewest, float* slope) {
  const auto tolerance = static_cast<float>(agree);
  const auto pixel_slope = [&](int x, int y) {
    const float z = view.depth[static_cast<std::size_t>(y) * view.width + x];
    if (std::isnan(z)) return z;
    PlaneFit fit;
    for (int v = std::max(0, y - radius); v <= std::min(view.height - 1, y + radius); ++v)
      for (int u = std::max(0, x - radius); u <= std::min(view.width - 1, x + radius); ++u) {
        const float other = view.depth[static_cast<std::size_t>(v) * view.width + u];
        // Relative to this pixel's inverse depth, or the sums of squares would drown the differences.
        if (std::abs(other - z) <= tolerance * z)
          fit.add(static_cast<float>(u - x), static_cast<float>(v - y), (z - other) / other);
      }
    float a, b;
    if (fit.n < static_cast<float>(fewest) || !fit.solve(a, b)) return std::numeric_limits<float>::quiet_NaN();
    const auto fx = static_cast<float>(view.focal[0]), fy = static_cast<float>(view.focal[1]);
    const float du = static_cast<float>(x + 0.5 - view.centre[0]), dv = static_cast<float>(y + 0.5 - view.centre[1]);
    const float nx = a * fx, ny = b * fy, nz = 1.0f - a * du - b * dv, rx = du / fx, ry = dv / fy;
    return 1.0f / std::sqrt((nx * nx + ny * ny + nz * nz) * (rx * rx + ry * ry + 1.0f));
  };
  parallel_for(view.height, 16, [&](std::size_t begin, std::size_t end) {
    for (std::size_t y = begin; y < end; ++y)
      for (int x = 0; x < view.width; ++x)
        slope[y * view.width + x] = pixel_slope(x, static_cast<int>(y));
  });
}

}  // namespace goc
