// L_c of 3D Gaussian Splatting: (1 − λ)·L1 + λ·(1 − SSIM), with its gradient, in one pass over the image.
#pragma once
#include <cstdint>
#include <vector>

namespace goc {

struct PhotometricLoss {
  double loss;          // means over planes and pixels
  double square_error;  // mean, of x clamped to [0, 1]
};

// Keeps its workspace between calls.
class Photometric {
 public:
  // x and grad are (3, height, width), target (height, width, 3) of 0…255; grad = d loss / d x.
  PhotometricLoss operator()(const float* x, const std::uint8_t* target, int height, int width, float ssim_weight,
                             float* grad);

 private:
  std::vector<double> sums_;
};

}  // namespace goc
