#include "depth_gaps.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "threads.hpp"

namespace goc {
namespace {

constexpr std::size_t kGrain = 4096;
constexpr float kNone = std::numeric_limits<float>::quiet_NaN();

struct Gaps {
  float between = kNone, nearest = kNone;
};

// The point's depth and, by way of `corner` and `share`, where between four pixels it is seen; false where it is not.
bool seen_at(const Camera& camera, const float* point, double& z, std::size_t& corner, float (&share)[2]) {
  const double* m = camera.cam_from_world;
  double at[3];
  for (int i = 0; i < 3; ++i) at[i] = m[4 * i] * point[0] + m[4 * i + 1] * point[1] + m[4 * i + 2] * point[2] + m[4 * i + 3];
  z = at[2];
  if (!(z > 0)) return false;
  const double x = at[0] / z * camera.fx + camera.cx - 0.5, y = at[1] / z * camera.fy + camera.cy - 0.5;
  if (!(x >= 0 && y >= 0 && x < camera.width - 1 && y < camera.height - 1)) return false;
  const double column = std::floor(x), row = std::floor(y);
  corner = static_cast<std::size_t>(row) * camera.width + static_cast<std::size_t>(column);
  share[0] = static_cast<float>(x - column);
  share[1] = static_cast<float>(y - row);
  return true;
}

Gaps gaps(const float* point, const Camera& camera, const float* depth, float one_surface) {
  double z;
  std::size_t corner;
  float share[2];
  if (!seen_at(camera, point, z, corner, share)) return {};
  const std::size_t width = camera.width;
  const float four[4] = {depth[corner], depth[corner + 1], depth[corner + width], depth[corner + width + 1]};
  const float weights[4] = {(1 - share[0]) * (1 - share[1]), share[0] * (1 - share[1]), (1 - share[0]) * share[1],
                            share[0] * share[1]};
  float inverse = 0, low = four[0], high = four[0];
  bool whole = true;
  Gaps found;
  for (int i = 0; i < 4; ++i) {
    inverse += weights[i] / four[i];  // planes are linear in 1/z
    low = std::min(low, four[i]);
    high = std::max(high, four[i]);
    const float gap = four[i] - static_cast<float>(z);
    if (std::isnan(gap)) whole = false;
    else if (!(std::abs(gap) >= std::abs(found.nearest))) found.nearest = gap;
  }
  const float smooth = 1 / inverse;
  if (whole && high - low < one_surface * smooth) found.between = found.nearest = smooth - static_cast<float>(z);
  return found;
}

}  // namespace

void depth_gaps(const float* points, std::size_t count, const Camera& camera, const float* depth, float one_surface,
                float* between, float* nearest) {
  parallel_for(count, kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const Gaps found = gaps(points + 3 * i, camera, depth, one_surface);
      between[i] = found.between;
      nearest[i] = found.nearest;
    }
  });
}

}  // namespace goc
