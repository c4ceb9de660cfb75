// Eq. (5) of the paper between two images, one of which is known in part: 0.85·(1 − SSIM)/2 + 0.15·|x − y|.
#pragma once
#include <cstddef>
#include <vector>

namespace goc {

struct MaskedImages {
  const float* x;      // (3, height, width)
  const float* y;      // (3, height, width)
  const float* known;  // (height, width): 1 where x is known, else 0; x and y must be finite there too
  int width, height;
};

struct PixelSum {
  double value = 0;
  std::size_t pixels = 0;
  PixelSum& operator+=(const PixelSum& other) {
    value += other.value, pixels += other.pixels;
    return *this;
  }
};

// SSIM in 3×3 blocks, as in the loss that Eq. (5) is (Godard et al. 2017). A pixel counts where all nine of its block are
// known, so that nothing unknown leaks in. Keeps its workspace between calls.
class BlockSsim {
 public:
  // The sum over pixels that count, and in x_grad (3, height, width) its gradient.
  PixelSum operator()(const MaskedImages& images, float* x_grad);

 private:
  PixelSum block_row(const MaskedImages& images, int row);
  void grad_row(const MaskedImages& images, int row, float* x_grad) const;

  std::vector<float> counted_;  // (height, width): 1 where the whole block is known
  std::vector<float> maps_;     // (3, 3, height, width): a block's SSIM by its mean x, x² and xy, of each colour
  std::vector<PixelSum> sums_;  // of each row
};

}  // namespace goc
