// This instruction set's kernels, for dispatch.cpp.
#include "kernels.hpp"

#define GOC_TEXT_(x) #x
#define GOC_TEXT(x) GOC_TEXT_(x)

namespace goc::GOC_ISA {

extern const Kernels kKernels;
const Kernels kKernels = {
    GOC_TEXT(GOC_ISA), touched_blocks, forward_tile, median_tile, backward_tile, blur_row, blur_column, ssim_row, adam_run,
};

}  // namespace goc::GOC_ISA
