// L_d and L_dn of paper §4.2 on a rendered depth, with their gradient; and the fraction that a depth of planes is.
#pragma once
#include <cstdint>
#include <vector>

#include "camera.hpp"

namespace goc {

struct DepthImages {
  const float* numerator;      // depth = numerator / denominator (height, width)
  const float* denominator;
  const float* alpha;          // (height, width)
  const float* prior_depth;    // z, NaN = none
  const float* prior_normals;  // (height, width, 3) unit, camera axes, NaN = none; may be null
  const std::int8_t* packed_normals;  // the same as signed bytes of any length, 0 0 0 = none; may be null
};

struct GeometryLosses {
  double depth, depth_normal;  // means over their valid pixels
};

// Keeps its workspace between calls.
class GeometryLoss {
 public:
  // Fills the gradients of depth_weight·L_d + normal_weight·L_dn with respect to numerator and denominator.
  GeometryLosses operator()(const DepthImages& images, const Lens& lens, float depth_weight, float normal_weight,
                            float* numerator_grad, float* denominator_grad);

 private:
  float* row(std::vector<float>& image, int y);

  int pitch_ = 0;
  std::vector<float> depth_, to_right_, to_left_, to_below_, to_above_;  // (height + 2, pitch), with a border
  std::vector<double> sums_;
};

// planes: blended normals and plane distance (4, height, width). Depth = D / (N·ray), both negated to be positive.
void plane_fraction(const float* planes, const Lens& lens, float* numerator, float* denominator);
void plane_fraction_backward(const float* numerator_grad, const float* denominator_grad, const Lens& lens,
                             float* planes_grad);

}  // namespace goc
