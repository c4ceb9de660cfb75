// The kernels of one instruction set, declared in its namespace.
#pragma once
#include "../lanes.hpp"

namespace goc::GOC_ISA {

std::uint32_t project_lanes(const SplatLanes& in, const DrawCamera& camera, bool planes, ProjectedLanes& out,
                            Footprints& footprints);
void project_lanes_backward(const SplatLanes& in, const DrawCamera& camera, const ProjectedLanes& grad, bool planes,
                            bool depths, SplatLanes& out);
void harmonics_lanes(const SplatLanes& in, const float* eye, int count, float (*out)[16]);
std::uint16_t touched_blocks(const Splat2D& splat, float slope_x, float slope_y, int x, int y);
void forward_tile(const TileView& tile, float* const* image, float* alpha, std::uint32_t* scratch);
void median_tile(const TileView& tile, float* median, std::uint32_t* scratch);
void backward_tile(const TileView& tile, const float* const* image, const float* alpha, const float* const* image_grad,
                   const float* alpha_grad, bool channels_only, float* grads, int grad_stride);
void moments_row(const float* x, const float* y, int pitch, float* out);
float ssim_row(const float* const* rows, int width, int pitch, float* grad_mean, float* grad_xx, float* grad_xy);
void maps_row(const float* padded, int pitch, float* out);
void photometric_row(const float* const* rows, const float* x, const float* y, int width, int pitch, float scale_ssim,
                     float scale_l1, float* grad, float* sums);
void depth_row(const float* numerator, const float* denominator, const float* alpha, const float* prior, int width,
               float* depth, float* sums);
void normal_row(const NormalRow& row, int width, float* const* out, float* sums);
void depth_grad_row(const DepthGradRow& row, int width, float* numerator_grad, float* denominator_grad);
void fraction_row(const float* const* plane, float first_x, float step_x, float ray_y, int width, float* numerator,
                  float* denominator);
void fraction_grad_row(const float* numerator_grad, const float* denominator_grad, float first_x, float step_x,
                       float ray_y, int width, float* const* plane_grad);
void penalty_rows(const float* logits, const float* log_scales, std::size_t count, float opacity, float scale,
                  float* logits_grad, float* log_scales_grad);
void adam_rows(const AdamRows& rows, std::size_t count, const AdamStep& step);
void pair_row(const PairRow& row, float* error, int* smooth);
void block_columns(const float* x, const float* y, int width, float* out);
float block_row(const float* columns, const float* counted, const float* x, const float* y, int width, float* by_mean,
                float* by_square, float* by_product);
void block_grad_row(const float* const* columns, const float* x, const float* y, const float* counted, int width,
                    float* out);
void warp_row(const WarpedRow& warp, int width, float* greys, float* inside);
void match_row(const float* const* rows, const float* const* warped, const float* mean, const float* scale,
               const float* inside, int width, float* scratch, float* costs);
void keep_best(const float* costs, int width, float* first, float* second, float* third);
float path_step(const float* costs, const float* before, float best_before, float step, float jump, int planes,
                float* now, float* total);
void patch_costs(const Patches& patches, const Target& target, const float* q, const float* gx, const float* gy,
                 float* costs);
void plane_normal_row(const FitRow& row, float* const* normal);
void fuse_block(const FusedView& view, const float* first, bool passed, float* sums, std::size_t stride);

}  // namespace goc::GOC_ISA
