// One step of Adam (Kingma & Ba 2015) on a run of rows, and the penalties on opacity and size.
#include "kernels.hpp"
#include "powers.hpp"

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

void penalty_rows(const float* logits, const float* log_scales, std::size_t count, float opacity, float scale,
                  float* logits_grad, float* log_scales_grad) {
  constexpr float kLog2E = 1.4426950408889634f;
  alignas(64) float buffer[4][16];  // logits, and log scales axis by axis; pulls in their place
  for (std::size_t first = 0; first < count; first += 16) {
    const int some = (int)(count - first < 16 ? count - first : 16);
    for (int l = 0; l < 16; ++l) {
      const std::size_t i = first + (l < some ? l : 0);
      buffer[0][l] = logits[i];
      for (int k = 0; k < 3; ++k) buffer[1 + k][l] = log_scales[3 * i + k];
    }
    const Lanes o = splat(1.0f) / (exp2(load(buffer[0]) * -kLog2E) + 1.0f);
    store(buffer[0], o * (1.0f - o) * opacity);
    for (int k = 1; k < 4; ++k) store(buffer[k], exp2(load(buffer[k]) * kLog2E) * scale);
    for (int l = 0; l < some; ++l) {
      const std::size_t i = first + l;
      if (logits_grad[i] == 0.0f) continue;
      logits_grad[i] += buffer[0][l];
      for (int k = 0; k < 3; ++k) log_scales_grad[3 * i + k] += buffer[1 + k][l];
    }
  }
}

}  // namespace goc::GOC_ISA
