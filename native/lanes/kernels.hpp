// The kernels of one instruction set, declared in its namespace.
#pragma once
#include "../lanes.hpp"

namespace goc::GOC_ISA {

std::uint16_t touched_blocks(const Splat2D& splat, float tile_x, float tile_y);
void forward_tile(const TileView& tile, float* const* image, float* alpha, std::uint32_t* scratch);
void median_tile(const TileView& tile, float* median, std::uint32_t* scratch);
void backward_tile(const TileView& tile, const float* const* image, const float* alpha, const float* const* image_grad,
                   const float* alpha_grad, bool channels_only, float* grads, int grad_stride);
void blur_row(const float* padded, int width, float* out);
void blur_column(const float* const* rows, int width, float* out);
double ssim_row(const float* mean_x, const float* mean_y, const float* xx, const float* yy, const float* xy, int width,
                float* grad_mean, float* grad_xx, float* grad_xy);
void adam_run(float* x, const float* g, float* m, float* v, std::size_t count, const AdamStep& step);

}  // namespace goc::GOC_ISA
