#include <cmath>

#include "stereo.hpp"

namespace goc {
namespace {

struct Seen {
  float x, y, inverse;  // where a point lands, and its inverse depth there
};

Seen land(const Transfer& to, float x, float y, float q) {
  const float z = to.m[6] * x + to.m[7] * y + to.m[8] + q * to.t[2];
  // z is depth there over depth here.
  return {(to.m[0] * x + to.m[1] * y + to.m[2] + q * to.t[0]) / z,
          (to.m[3] * x + to.m[4] * y + to.m[5] + q * to.t[1]) / z, q / z};
}

}  // namespace

void agree_view(const Photos& photos, int view, Neighbours neighbours, const float* planes,
                const AgreeSettings& settings, float* inverse, std::uint8_t* agreeing, std::uint8_t* against) {
  const Camera& camera = photos.cameras[view];
  const float* own = planes + 3 * photos.pixel(view, 0, 0);
  std::vector<float> sums(static_cast<std::size_t>(photos.width) * photos.height);
  for (std::size_t i = 0; i < sums.size(); ++i) sums[i] = own[3 * i], agreeing[i] = against[i] = 0;
  for (int k = 0; k < neighbours.stride; ++k) {
    const int other = neighbours.views[static_cast<std::size_t>(view) * neighbours.stride + k];
    if (other < 0) continue;
    const Camera& there = photos.cameras[other];
    const Transfer to = transfer(camera, there), back = transfer(there, camera);
    for (int y = 0; y < camera.height; ++y)
      for (int x = 0; x < camera.width; ++x) {
        const std::size_t at = static_cast<std::size_t>(y) * photos.width + x;
        const float q = own[3 * at];
        const Seen seen = land(to, static_cast<float>(x), static_cast<float>(y), q);
        if (!(q > 0 && seen.inverse > 0 && seen.x > -0.5f && seen.y > -0.5f &&
              seen.x < static_cast<float>(there.width) - 0.5f && seen.y < static_cast<float>(there.height) - 0.5f))
          continue;
        const int near_x = static_cast<int>(seen.x + 0.5f), near_y = static_cast<int>(seen.y + 0.5f);
        const float* plane = planes + 3 * photos.pixel(other, near_x, near_y);
        if (!(plane[0] > 0)) continue;
        const float found = plane[0] + plane[1] * (seen.x - static_cast<float>(near_x)) +
                            plane[2] * (seen.y - static_cast<float>(near_y));
        const Seen returned = land(back, seen.x, seen.y, found);
        const float off = std::hypot(returned.x - static_cast<float>(x), returned.y - static_cast<float>(y));
        const float difference = seen.inverse / found - 1.0f;  // positive: nearer than what the other view sees
        if (found > 0 && returned.inverse > 0 && off <= settings.pixels && std::abs(difference) <= settings.relative) {
          sums[at] += returned.inverse;
          ++agreeing[at];
        } else if (difference > 3.0f * settings.relative) {
          ++against[at];
        }
      }
  }
  for (std::size_t i = 0; i < sums.size(); ++i) inverse[i] = sums[i] / static_cast<float>(1 + agreeing[i]);
}

}  // namespace goc
