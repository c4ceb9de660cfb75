// L_c of 3D Gaussian Splatting: (1 − λ)·L1 + λ·(1 − SSIM), with its gradient, in one call.
#pragma once
#include <vector>

namespace goc {

// Keeps its workspace between calls: a training step allocates nothing.
class Photometric {
 public:
  // x, y and grad are (planes, height, width); grad = d loss / d x. Returns the loss (means over planes and pixels).
  double operator()(const float* x, const float* y, int planes, int height, int width, float ssim_weight, float* grad);

 private:
  std::vector<float> rows_, maps_;
  std::vector<double> sums_;
};

}  // namespace goc
