// How well the surface of one view fits another view, and how it would have to move: normal equations of both.
#pragma once
#include "camera.hpp"

namespace goc {

// What one view shows at some pixels, in its own axes.
struct Surface {
  int count;
  const float* points;   // count x 3
  const float* normals;  // count x 3, unit
  const float* grey;     // count
};

// Images of the view that it is compared with.
struct Target {
  Camera camera;
  const float* depth;    // z; NaN = none
  const float* normals;  // 3 a pixel, unit, camera axes; NaN = none
  const float* grey;
};

// Lengths in scene units.
struct RegisterLimits {
  double noise, noise_square;  // standard deviation of depth z: noise + noise_square z^2
  double reach;                // gaps beyond belong to other surfaces
  double cosine;               // of the angle between normals of one surface, at least
};

constexpr int kRegisterTerms = 6 * 6 + 6 + 2;
constexpr int kRegisterSums = 2 * kRegisterTerms + 2;

// Sums over the points that both views see. A twist (turn, shift) in the target's axes moves the surface; r(twist) ≈ r + a·twist.
// out: for gaps along the target's normals, then for differences of grey: Σ w a aᵀ (36), Σ w a r (6), points, Σ|r|;
// then gain and offset that make the surface's grey the target's.
void register_surface(const Surface& surface, const Camera& seen_from, const Target& target, const RegisterLimits& limits,
                      double* out);

}  // namespace goc
