#include "multiview.hpp"

#include <algorithm>

#include "lanes.hpp"
#include "threads.hpp"

namespace goc {
namespace {

constexpr int kColours = 3;
constexpr std::size_t kRowGrain = 8;

}  // namespace

MultiviewLosses MultiviewLoss::operator()(const WarpedView& view, const WarpSource& source,
                                          const MultiviewWeights& weights, float* numerator_grad,
                                          float* denominator_grad, float* inverse_grad) {
  const Lens lens = view.camera.lens(), source_lens = source.camera.lens();
  const int w = lens.width, h = lens.height;
  float from_view[12];
  between(view.camera, source.camera, from_view);
  const std::size_t size = (std::size_t)w * h;
  depth_.resize(size);
  const bool colours = weights.photometric != 0, back = weights.geometric != 0;
  known_.resize(size), geometric_grad_.resize(size), warped_grad_.resize(size * kColours);
  for (auto* images : {&warped_, &seen_, &slope_, &pulls_}) images->resize(size * kColours);
  geometric_sums_.assign(h, {});
  parallel_for(h, kRowGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t y = begin; y < end; ++y) {
      const std::size_t at = y * w;
      const auto from = [&](auto& images, bool wanted) { return wanted ? images.data() + at : nullptr; };
      const PairRow row{view.numerator + at, view.denominator + at, view.alpha + at, view.image + at * kColours, (int)y,
                        lens, source.image, source_lens, source.inverse_depth, source.depth_lens, from_view,
                        weights.tolerance, size, depth_.data() + at, known_.data() + at,
                        from(warped_, colours), from(seen_, colours), from(slope_, colours),
                        from(geometric_grad_, back), from(pulls_, back && inverse_grad)};
      float error;
      int smooth;
      kernels().pair_row(row, &error, &smooth);
      geometric_sums_[y] = {error, (std::size_t)smooth};
    }
  });
  PixelSum photometric, geometric;
  if (colours)
    photometric = ssim_({warped_.data(), seen_.data(), known_.data(), w, h}, warped_grad_.data());
  for (const PixelSum& row : geometric_sums_) geometric += row;
  const std::size_t fewest = std::max<std::size_t>(size / 4, 1);  // a handful of pixels must not pull like a view
  const double pixels = (double)std::max(photometric.pixels, fewest);
  const double matches = (double)std::max(geometric.pixels, fewest);
  const float geometric_scale = (float)(weights.geometric / matches);
  add_to_depth(view, (float)(weights.photometric / pixels), geometric_scale, numerator_grad, denominator_grad);
  if (inverse_grad) scatter_pulls(source.depth_lens, geometric_scale, inverse_grad);
  return {photometric.value / pixels, geometric.value / matches};
}

void MultiviewLoss::add_to_depth(const WarpedView& view, float photometric, float geometric, float* numerator_grad,
                                 float* denominator_grad) const {
  const std::size_t size = depth_.size(), w = view.camera.width;
  parallel_for(view.camera.height, kRowGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin * w; i < end * w; ++i) {
      float g = geometric != 0 ? geometric * geometric_grad_[i] : 0.0f;
      if (photometric != 0)
        for (int k = 0; k < kColours; ++k) g += photometric * warped_grad_[k * size + i] * slope_[k * size + i];
      const float inverse = depth_[i] > 0 ? 1.0f / view.denominator[i] : 0.0f;
      numerator_grad[i] = g * inverse;
      denominator_grad[i] = -g * depth_[i] * inverse;
    }
  });
}

// In one thread: pixels of two rows may pull at one place.
void MultiviewLoss::scatter_pulls(const Lens& lens, float scale, float* inverse_grad) const {
  std::fill(inverse_grad, inverse_grad + (std::size_t)lens.width * lens.height, 0.0f);
  const std::size_t size = depth_.size();
  const float *u = pulls_.data(), *v = u + size, *amounts = v + size;
  for (std::size_t i = 0; i < size && scale != 0; ++i) {
    if (amounts[i] == 0) continue;
    const float x = u[i] - 0.5f, y = v[i] - 0.5f, amount = scale * amounts[i];
    const int left = (int)x, top = (int)y;
    const float along = x - (float)left, down = y - (float)top;
    float* p = inverse_grad + (std::size_t)top * lens.width + left;
    p[0] += amount * (1 - along) * (1 - down);
    p[1] += amount * along * (1 - down);
    p[lens.width] += amount * (1 - along) * down;
    p[lens.width + 1] += amount * along * down;
  }
}

}  // namespace goc
