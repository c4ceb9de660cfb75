// One step of Adam (Kingma & Ba 2015) on a run of rows.
#include "kernels.hpp"
#include "simd.hpp"

namespace goc::GOC_ISA {

void adam_rows(const AdamRows& rows, std::size_t count, const AdamStep& step) {
  const std::size_t total = count * step.width, period = 16 * (std::size_t)step.width;
  std::size_t i = 0, r = 0;
  for (; i + 16 <= total; i += 16) {
    const Lanes g = load(rows.grad + i);
    const Lanes m = fma(load(rows.first + i), step.beta1, g * (1.0f - step.beta1));
    const Lanes v = fma(load(rows.second + i), step.beta2, g * g * (1.0f - step.beta2));
    store(rows.first + i, m), store(rows.second + i, v);
    store(rows.x + i, load(rows.x + i) - load(step.rates + r) * m / (sqrt(v) + step.epsilon));
    r = r + 16 == period ? 0 : r + 16;
  }
  for (; i < total; ++i, ++r) {
    const float g = rows.grad[i];
    const float m = rows.first[i] = step.beta1 * rows.first[i] + (1.0f - step.beta1) * g;
    const float v = rows.second[i] = step.beta2 * rows.second[i] + (1.0f - step.beta2) * g * g;
    rows.x[i] -= step.rates[r] * m / (__builtin_sqrtf(v) + step.epsilon);
  }
}

}  // namespace goc::GOC_ISA
