// Runs the engine on a fixed scene and compares it with what the portable kernels of x86-64 found there:
// `kernel_check expected.txt`, or `kernel_check expected.txt --write`. Needs no Python, so a cross compiler can build
// it and an emulator run it.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <string>
#include <vector>

#include "lanes.hpp"
#include "photometric.hpp"
#include "raster.hpp"

namespace {

using Floats = std::vector<float>;
constexpr int kWidth = 67, kHeight = 45, kSplats = 500, kHarmonics = 4;
constexpr int kPixels = kWidth * kHeight;
// Of the sum of magnitudes. Instruction sets differ in the last bits, and a splat at the edge of alpha 1/255 may flip.
constexpr double kTolerance = 1e-4;

// The same numbers in [0, 1) on every machine.
class Numbers {
 public:
  float next() {
    state_ = state_ * 6364136223846793005u + 1442695040888963407u;
    return (float)(state_ >> 40) / (float)(1 << 24);
  }
  Floats many(std::size_t count, float scale, float shift) {
    Floats out(count);
    for (float& x : out) x = next() * scale + shift;
    return out;
  }

 private:
  std::uint64_t state_ = 1;
};

// What an array is known by: its sum of magnitudes, and three sums with weights in [-1, 1).
struct Print {
  std::string name;
  double numbers[4];
};
Print print_of(const char* name, const Floats& values) {
  Numbers weights;
  Print out{name, {}};
  for (const float x : values) {
    out.numbers[0] += std::abs(x);
    for (int k = 1; k < 4; ++k) out.numbers[k] += x * (2.0 * weights.next() - 1.0);
  }
  return out;
}

// A view of random splats and its gradient, L_c of the image, and a step of Adam on the means.
std::vector<Print> prints() {
  Numbers random;
  Floats means = random.many(3 * kSplats, 3.0f, -1.5f);
  for (int i = 0; i < kSplats; ++i) means[3 * i + 2] += 2.5f;
  const Floats quats = random.many(4 * kSplats, 2.0f, -1.0f), scales = random.many(3 * kSplats, 1.5f, -4.0f);
  const Floats logits = random.many(kSplats, 4.0f, -2.0f), sh = random.many(3 * kHarmonics * kSplats, 1.0f, -0.5f);
  const Floats image_grad = random.many(7 * kPixels, 2.0f, -1.0f), alpha_grad = random.many(kPixels, 2.0f, -1.0f);
  Floats image(7 * kPixels), alpha(kPixels), loss_grad(3 * kPixels), sh_grad(sh.size());
  Floats d_means(means.size()), d_quats(quats.size()), d_scales(scales.size()), d_logits(logits.size());
  const goc::DrawCamera camera{55, 58, 33, 23, kWidth, kHeight, {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0},
                               {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}};
  const goc::SplatArrays splats{means.data(), quats.data(), scales.data(), logits.data(), kSplats};
  goc::Channels channels;
  channels.sh = sh.data(), channels.harmonics = kHarmonics, channels.planes = true;
  float* planes[7];
  const float *shown[7], *grads[7];
  for (int c = 0; c < 7; ++c)
    shown[c] = planes[c] = image.data() + c * kPixels, grads[c] = image_grad.data() + c * kPixels;
  goc::Raster raster;
  raster.forward(splats, channels, camera, planes, alpha.data());
  const goc::SplatGradients out{d_means.data(), d_quats.data(), d_scales.data(), d_logits.data()};
  raster.backward(splats, channels, shown, alpha.data(), grads, alpha_grad.data(), &out, {sh_grad.data(), nullptr});

  std::vector<std::uint8_t> photograph(3 * kPixels);
  for (auto& byte : photograph) byte = (std::uint8_t)(255.0f * random.next());
  goc::Photometric photometric;
  const auto loss = photometric(image.data(), photograph.data(), kHeight, kWidth, 0.2f, loss_grad.data());

  Floats first(means.size()), second(means.size());
  const Floats rates(16 * 3, 0.01f);
  goc::kernels().adam_rows({means.data(), d_means.data(), first.data(), second.data()}, kSplats,
                           {0.9f, 0.999f, 1e-3f, rates.data(), 3});
  return {print_of("image", image),         print_of("alpha", alpha),       print_of("means' gradient", d_means),
          print_of("quats' gradient", d_quats), print_of("log scales' gradient", d_scales),
          print_of("logits' gradient", d_logits), print_of("harmonics' gradient", sh_grad),
          print_of("L_c", {(float)loss.loss}), print_of("L_c's gradient", loss_grad), print_of("means after Adam", means)};
}

}  // namespace

int main(int argc, char** argv) {
  const bool write = argc == 3 && !std::strcmp(argv[2], "--write");
  std::FILE* file = argc >= 2 ? std::fopen(argv[1], write ? "w" : "r") : nullptr;
  if (!file) return std::fprintf(stderr, "usage: kernel_check expected.txt [--write]\n"), 2;
  int wrong = 0;
  double worst = 0.0;
  for (const Print& found : prints()) {
    double expected[4];
    for (int k = 0; k < 4; ++k) {
      if (write) {
        std::fprintf(file, "%.9g%c", found.numbers[k], k < 3 ? ' ' : '\n');
      } else if (std::fscanf(file, "%lf", expected + k) != 1) {
        return std::fprintf(stderr, "%s ends before %s\n", argv[1], found.name.c_str()), 2;
      }
    }
    if (write) continue;
    for (int k = 0; k < 4; ++k) {
      const double error = std::abs(found.numbers[k] - expected[k]) / expected[0];
      worst = std::max(worst, error);
      if (error <= kTolerance) continue;
      std::fprintf(stderr, "%s: %s differs by %.1e of its magnitude\n", goc::kernels().name, found.name.c_str(), error);
      ++wrong;
    }
  }
  std::fclose(file);
  std::printf("%s kernels: worst difference %.1e\n", goc::kernels().name, worst);
  return wrong ? 1 : 0;
}
