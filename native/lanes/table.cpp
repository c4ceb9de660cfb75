// This instruction set's kernels, for dispatch.cpp.
#include "kernels.hpp"

#define GOC_TEXT_(x) #x
#define GOC_TEXT(x) GOC_TEXT_(x)

namespace goc::GOC_ISA {

extern const Kernels kKernels;
const Kernels kKernels = {
    GOC_TEXT(GOC_ISA), project_lanes, project_lanes_backward, harmonics_lanes, touched_blocks, forward_tile,   median_tile,  backward_tile,     moments_row, ssim_row, maps_row,
    photometric_row,   depth_row,      normal_row,     depth_grad_row, fraction_row,    fraction_grad_row, penalty_rows, adam_rows,
    pair_row, block_columns, block_row, block_grad_row,
    warp_row, match_row, keep_best, path_step, patch_costs, plane_normal_row, fuse_block,
};

}  // namespace goc::GOC_ISA
