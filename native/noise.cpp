#include "noise.hpp"

#include <cmath>

#include "threads.hpp"

namespace goc {
namespace {

constexpr std::size_t kGrain = 4096;

// Trilinear between the eight lattice values round a point, along a smooth step of each coordinate.
float value_noise(const double* point, double scale, double offset, const float* lattice) {
  unsigned low[3], high[3];
  float step[3];
  for (int axis = 0; axis < 3; ++axis) {
    const double at = point[axis] * scale + offset;
    const double floor = std::floor(at);
    const auto t = static_cast<float>(at - floor);
    step[axis] = t * t * (3.0f - 2.0f * t);
    low[axis] = static_cast<unsigned>(static_cast<long long>(floor)) % kNoisePeriod;
    high[axis] = (low[axis] + 1) % kNoisePeriod;
  }
  const auto along_z = [&](unsigned x, unsigned y) {
    const float* row = lattice + (x * kNoisePeriod + y) * kNoisePeriod;
    return row[low[2]] + step[2] * (row[high[2]] - row[low[2]]);
  };
  const auto along_y = [&](unsigned x) {
    const float near = along_z(x, low[1]);
    return near + step[1] * (along_z(x, high[1]) - near);
  };
  const float near = along_y(low[0]);
  return near + step[0] * (along_y(high[0]) - near);
}

}  // namespace

void fractal_noise(const double* points, std::size_t count, const float* lattice, int octaves, float* values) {
  parallel_for(count, kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      float total = 0.0f, weight = 1.0f, weights = 0.0f;
      for (int octave = 0; octave < octaves; ++octave) {
        // The offset keeps the lattice points of the octaves apart.
        total += weight * value_noise(points + 3 * i, std::ldexp(1.0, octave), 17.3 * octave, lattice);
        weights += weight;
        weight *= 0.5f;
      }
      values[i] = total / weights;
    }
  });
}

}  // namespace goc
