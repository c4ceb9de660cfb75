#include "cells.hpp"

#include <algorithm>
#include <cmath>

#include "threads.hpp"

namespace goc {
namespace {

constexpr int kBits = 16;
constexpr double kBias = 1 << (kBits - 1);

// Appends a row's pixels; neighbours that share a cell, as most do, become one entry.
void count_row(const DepthView& view, double cell, std::size_t y,
               std::vector<std::pair<std::uint64_t, std::int64_t>>& counts) {
  const Camera& camera = view.camera;
  for (int x = 0; x < camera.width; ++x) {
    const std::size_t pixel = y * camera.width + x;
    if (std::isnan(view.slope[pixel])) continue;
    const double z = view.depth[pixel], cx = (x + 0.5 - camera.cx) / camera.fx * z,
                 cy = (static_cast<double>(y) + 0.5 - camera.cy) / camera.fy * z;
    auto key = static_cast<std::uint64_t>((view.ids ? view.ids[pixel] : 0) + static_cast<int>(kBias));
    bool inside = true;
    for (int row = 0; row < 3; ++row) {
      const double* r = camera.world_from_cam + 4 * row;
      const double index = std::floor((r[0] * cx + r[1] * cy + r[2] * z + r[3]) / cell) + kBias;
      inside = inside && index >= 0 && index < 2 * kBias;  // beyond is no room, and would wrap
      key = key << kBits | (inside ? static_cast<std::uint64_t>(index) : 0);
    }
    if (!inside) continue;
    if (!counts.empty() && counts.back().first == key) {
      ++counts.back().second;
    } else {
      counts.emplace_back(key, 1);
    }
  }
}

}  // namespace

void count_cells(const DepthView& view, double cell, std::vector<std::uint64_t>& keys, std::vector<std::int64_t>& hits) {
  constexpr std::size_t kRows = 32;
  const std::size_t height = view.camera.height;
  std::vector<std::vector<std::pair<std::uint64_t, std::int64_t>>> chunks((height + kRows - 1) / kRows);
  parallel_for(chunks.size(), 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t chunk = begin; chunk < end; ++chunk)
      for (std::size_t y = chunk * kRows; y < std::min(height, (chunk + 1) * kRows); ++y)
        count_row(view, cell, y, chunks[chunk]);
  });
  std::vector<std::pair<std::uint64_t, std::int64_t>> all;
  for (const auto& chunk : chunks) all.insert(all.end(), chunk.begin(), chunk.end());
  std::sort(all.begin(), all.end());
  for (const auto& [key, count] : all) {
    if (!keys.empty() && keys.back() == key) {
      hits.back() += count;
    } else {
      keys.push_back(key);
      hits.push_back(count);
    }
  }
}

}  // namespace goc
