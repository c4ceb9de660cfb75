#include <algorithm>
#include <cmath>
#include <cstring>

#include "lanes.hpp"
#include "stereo.hpp"

namespace goc {
namespace {

constexpr int kLanes = kPatchLanes;
constexpr float kLikeGrey = 25.0f;  // of 255: a sample that differs this much from the middle counts half

// Uniform in [−1, 1), the same for the same place whatever ran before (splitmix64).
float noise(std::uint64_t seed, std::uint64_t place, std::uint64_t draw) {
  std::uint64_t x = seed + 0x9e3779b97f4a7c15ull * (place * 64 + draw + 1);
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9ull;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebull;
  return static_cast<float>((x ^ (x >> 31)) >> 40) * 0x1p-23f - 1.0f;
}

struct Planes {
  float q[kLanes], gx[kLanes], gy[kLanes];
};

struct Refine {
  const Photos& photos;
  int view, width, height, stride;
  std::vector<Target> targets;
  float step;
  const RefineSettings& settings;
  float* planes;
  float* costs;
  std::vector<float> prior;

  Refine(const Photos& photos, int view, Neighbours neighbours, float step, const RefineSettings& settings,
         float* planes, float* costs)
      : photos(photos), view(view), width(photos.cameras[view].width), height(photos.cameras[view].height),
        stride(photos.width), step(step), settings(settings), planes(planes), costs(costs) {
    for (int k = 0; k < neighbours.stride; ++k) {
      const int other = neighbours.views[static_cast<std::size_t>(view) * neighbours.stride + k];
      if (other < 0) continue;
      const Camera& camera = photos.cameras[other];
      Target target{photos.quads.data() + photos.pixel(other, 0, 0), photos.width,
                    static_cast<float>(camera.width - 1), static_cast<float>(camera.height - 1), {}, {}};
      const Transfer to = transfer(photos.cameras[view], camera);
      std::memcpy(target.m, to.m, sizeof to.m);
      std::memcpy(target.t, to.t, sizeof to.t);
      targets.push_back(target);
    }
    prior.resize(static_cast<std::size_t>(stride) * photos.height);
    for (std::size_t i = 0; i < prior.size(); ++i) prior[i] = planes[3 * i];
  }

  std::size_t at(int x, int y) const { return static_cast<std::size_t>(y) * stride + x; }

  // Windows of the pixels x0, x0 + 2, … of a row; lanes beyond its end repeat its last pixel.
  void look(int x0, int y, Patches& patches) const {
    const float* greys = photos.greys.data() + photos.pixel(view, 0, 0);
    float middle[kLanes], total[kLanes] = {}, sum[kLanes] = {}, squares[kLanes] = {};
    int xs[kLanes];
    for (int i = 0; i < kLanes; ++i) {
      xs[i] = std::min(x0 + 2 * i, width - 1);
      patches.x[i] = static_cast<float>(xs[i]), patches.y[i] = static_cast<float>(y);
      middle[i] = greys[at(xs[i], y)];
    }
    for (int s = 0; s < kPatchSamples; ++s) {
      const int dx = static_cast<int>(kPatchSpacing * (s % kPatchSide - 0.5f * (kPatchSide - 1)));
      const int dy = static_cast<int>(kPatchSpacing * (s / kPatchSide - 0.5f * (kPatchSide - 1)));
      const float* row = greys + at(0, std::clamp(y + dy, 0, height - 1));
      for (int i = 0; i < kLanes; ++i) {
        const float grey = row[std::clamp(xs[i] + dx, 0, width - 1)], off = (grey - middle[i]) * (1.0f / kLikeGrey);
        const float weight = 1.0f / (1.0f + off * off);
        patches.grey[s][i] = grey, patches.weight[s][i] = weight;
        total[i] += weight, sum[i] += weight * grey, squares[i] += weight * grey * grey;
      }
    }
    for (int i = 0; i < kLanes; ++i) {
      const float over = 1.0f / total[i];
      for (int s = 0; s < kPatchSamples; ++s) patches.weight[s][i] *= over;
      patches.mean[i] = sum[i] * over;
      const float variance = std::max(0.0f, squares[i] * over - patches.mean[i] * patches.mean[i]);
      patches.scale[i] = 1.0f / std::sqrt(variance + kGreyNoise * kGreyNoise);
    }
  }

  // Mean of the three best neighbours' costs; those that are missing count as 1.
  void match(const Patches& patches, const Planes& tried, float* cost) const {
    float best[3][kLanes], one[kLanes];
    for (auto& row : best) std::fill_n(row, kLanes, 1.0f);
    for (const Target& target : targets) {
      kernels().patch_costs(patches, target, tried.q, tried.gx, tried.gy, one);
      kernels().keep_best(one, kLanes, best[0], best[1], best[2]);
    }
    for (int i = 0; i < kLanes; ++i) cost[i] = (best[0][i] + best[1][i] + best[2][i]) * (1.0f / 3.0f);
  }

  // Adds what it costs to leave the sweep's inverse depth; nothing more beyond three of its steps.
  float with_prior(float cost, float q, std::size_t pixel) const {
    return cost + settings.prior_weight * std::min(1.0f, std::abs(q - prior[pixel]) / (3.0f * step));
  }

  // Takes over planes that match better.
  void try_planes(const Patches& patches, const Planes& tried, int x0, int y, float* held) {
    float cost[kLanes];
    match(patches, tried, cost);
    for (int i = 0; i < kLanes && x0 + 2 * i < width; ++i) {
      const std::size_t pixel = at(x0 + 2 * i, y);
      const float whole = with_prior(cost[i], tried.q[i], pixel);
      if (!(tried.q[i] > 0) || !(whole < held[i])) continue;
      held[i] = whole, costs[pixel] = cost[i];
      planes[3 * pixel] = tried.q[i], planes[3 * pixel + 1] = tried.gx[i], planes[3 * pixel + 2] = tried.gy[i];
    }
  }

  Planes of_neighbours(int x0, int y, int dx, int dy) const {
    Planes tried;
    for (int i = 0; i < kLanes; ++i) {
      const int x = std::min(x0 + 2 * i, width - 1);
      const int from_x = std::clamp(x + dx, 0, width - 1), from_y = std::clamp(y + dy, 0, height - 1);
      const float* plane = planes + 3 * at(from_x, from_y);
      tried.q[i] = plane[0] + plane[1] * static_cast<float>(x - from_x) + plane[2] * static_cast<float>(y - from_y);
      tried.gx[i] = plane[1], tried.gy[i] = plane[2];
    }
    return tried;
  }

  // The own plane, moved and tilted; `reach` of a step, and a third of that a pixel of the window.
  Planes changed(int x0, int y, float reach, std::uint64_t draw) const {
    Planes tried;
    for (int i = 0; i < kLanes; ++i) {
      const std::size_t pixel = at(std::min(x0 + 2 * i, width - 1), y);
      const float* plane = planes + 3 * pixel;
      const std::uint64_t place = photos.pixel(view, 0, 0) + pixel;
      tried.q[i] = plane[0] + reach * noise(settings.seed, place, draw);
      tried.gx[i] = plane[1] + reach * 0.3f * noise(settings.seed, place, draw + 1);
      tried.gy[i] = plane[2] + reach * 0.3f * noise(settings.seed, place, draw + 2);
    }
    return tried;
  }

  void visit(int x0, int y, int sweep) {
    // Far neighbours first, near ones later; an odd number of steps leads to a pixel that is not being changed.
    static constexpr int kFar[4][2] = {{-3, 0}, {3, 0}, {0, -3}, {0, 3}};
    static constexpr int kNear[4][2] = {{-1, 0}, {1, 0}, {0, -1}, {0, 1}};
    Patches patches;
    look(x0, y, patches);
    float held[kLanes];
    const Planes own = of_neighbours(x0, y, 0, 0);
    match(patches, own, held);
    for (int i = 0; i < kLanes && x0 + 2 * i < width; ++i) {
      const std::size_t pixel = at(x0 + 2 * i, y);
      costs[pixel] = held[i];
      held[i] = with_prior(held[i], own.q[i], pixel);
    }
    for (const auto& [dx, dy] : sweep % 2 ? kNear : kFar)
      try_planes(patches, of_neighbours(x0, y, dx, dy), x0, y, held);
    for (int k = 0; k < 2; ++k) {
      const float reach = step * (k ? 0.1f : 0.4f) / static_cast<float>(1 + sweep);
      try_planes(patches, changed(x0, y, reach, static_cast<std::uint64_t>(6 * sweep + 3 * k)), x0, y, held);
    }
  }
};

}  // namespace

void refine_view(const Photos& photos, int view, Neighbours neighbours, float step, const RefineSettings& settings,
                 float* planes, float* costs) {
  Refine refine(photos, view, neighbours, step, settings, planes, costs);
  for (int sweep = 0; sweep < settings.sweeps; ++sweep)
    for (int colour = 0; colour < 2; ++colour)
      for (int y = 0; y < refine.height; ++y)
        for (int x = (y + colour) % 2; x < refine.width; x += 2 * kLanes) refine.visit(x, y, sweep);
}

}  // namespace goc
