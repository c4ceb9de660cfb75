#include <cstdlib>
#include <cstring>

#include "lanes.hpp"

namespace goc {
namespace {

const Kernels& pick() {
#ifdef GOC_X86_64
  const char* wanted = std::getenv("GOC_SIMD");
  const bool has_avx512 = __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") &&
                          __builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("avx512vl");
  const bool has_avx2 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
  if (wanted && !std::strcmp(wanted, "portable")) return portable::kKernels;
  if (wanted && !std::strcmp(wanted, "avx2") && has_avx2) return avx2::kKernels;
  if (has_avx512) return avx512::kKernels;
  if (has_avx2) return avx2::kKernels;
#endif
  return portable::kKernels;
}

}  // namespace

const Kernels& kernels() {
  static const Kernels& chosen = pick();
  return chosen;
}

}  // namespace goc
