// L_pho (Eq. 5) and L_geo of paper §4.2, with their gradient: a rendered depth fetches a neighbour's photograph into the
// view, and carries the view's pixels to the neighbour's surface and back.
#pragma once
#include <cstdint>
#include <vector>

#include "block_ssim.hpp"
#include "camera.hpp"

namespace goc {

// The view that is drawn.
struct WarpedView {
  const float* numerator;  // depth = numerator / denominator (height, width)
  const float* denominator;
  const float* alpha;         // (height, width)
  const std::uint8_t* image;  // (height, width, 3)
  Camera camera;
};

// The neighbour that it is compared with.
struct WarpSource {
  const std::uint8_t* image;  // (height, width, 3)
  Camera camera;
  const float* inverse_depth;  // 1/z of every so many pixels, 0 = none
  Lens depth_lens;             // of those pixels
};

struct MultiviewWeights {
  float photometric, geometric;
  float tolerance;  // depths within this share of each other show one surface
};

struct MultiviewLosses {
  double photometric, geometric;  // means over the pixels that can be compared, or a quarter of all where those are fewer
};

// Keeps its workspace between calls.
class MultiviewLoss {
 public:
  // Fills the gradients of photometric·L_pho + geometric·L_geo with respect to numerator and denominator of the view's
  // depth and, unless it is null, to the neighbour's inverse depth.
  MultiviewLosses operator()(const WarpedView& view, const WarpSource& source, const MultiviewWeights& weights,
                             float* numerator_grad, float* denominator_grad, float* inverse_grad);

 private:
  void add_to_depth(const WarpedView& view, float photometric, float geometric, float* numerator_grad,
                    float* denominator_grad) const;
  void scatter_pulls(const Lens& lens, float scale, float* inverse_grad) const;

  BlockSsim ssim_;
  std::vector<float> depth_;                     // (height, width), 0 = none
  std::vector<float> warped_, seen_, slope_;     // (3, height, width): C̃, C and dC̃/dD, 0 where C̃ is not known
  std::vector<float> known_;                     // (height, width): 1 where C̃ is known, else 0
  std::vector<float> warped_grad_;               // (3, height, width): of the sum over pixels
  std::vector<float> geometric_grad_;            // (height, width): of the sum over pixels, by D
  std::vector<float> pulls_;                     // (3, height, width): pulls on the neighbour's 1/z; see PairRow
  std::vector<PixelSum> geometric_sums_;         // of each row
};

}  // namespace goc
