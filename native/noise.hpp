// Smooth pseudo-random fields: value noise on an integer lattice that repeats.
#pragma once
#include <cstddef>

namespace goc {

constexpr int kNoisePeriod = 64;

// Sums octaves of value noise at each point, each twice as fine and half as strong as the one before, scaled to the
// lattice's own range. `lattice` holds kNoisePeriod³ values, z fastest.
void fractal_noise(const double* points, std::size_t count, const float* lattice, int octaves, float* values);

}  // namespace goc
