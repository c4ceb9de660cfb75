// One step of Adam (Kingma & Ba 2015) on a run of numbers.
#include "kernels.hpp"

namespace goc::GOC_ISA {

void adam_run(float* __restrict x, const float* __restrict g, float* __restrict m, float* __restrict v,
              std::size_t count, const AdamStep& step) {
  for (std::size_t i = 0; i < count; ++i) {
    m[i] = step.beta1 * m[i] + (1.0f - step.beta1) * g[i];
    v[i] = step.beta2 * v[i] + (1.0f - step.beta2) * g[i] * g[i];
    x[i] -= step.rate * m[i] / (__builtin_sqrtf(v[i]) + step.epsilon);
  }
}

}  // namespace goc::GOC_ISA
