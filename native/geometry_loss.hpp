// L_d and L_dn of paper §4.2 on a rendered depth, with their gradient, in one pass.
#pragma once
#include <cstdint>
#include <vector>

namespace goc {

struct DepthView {
  const float* numerator;      // depth = numerator / denominator (height, width)
  const float* denominator;
  const float* alpha;          // (height, width)
  const float* prior_depth;    // z, NaN = none
  const float* prior_normals;  // (height, width, 3) unit, camera axes, NaN = none; may be null
  int width, height;
  float fx, fy, cx, cy;
};

struct GeometryLosses {
  double depth, depth_normal;  // means over their valid pixels
};

// Keeps its workspace between calls.
class GeometryLoss {
 public:
  // Fills the gradients of depth_weight·L_d + normal_weight·L_dn with respect to numerator and denominator.
  GeometryLosses operator()(const DepthView& view, float depth_weight, float normal_weight, float* numerator_grad,
                            float* denominator_grad);

 private:
  std::vector<float> depth_, pull_x_, pull_y_;  // pull: gradient of the differences along x and y, (height, width, 3)
  std::vector<double> sums_;
};

}  // namespace goc
