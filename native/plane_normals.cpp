#include "plane_normals.hpp"

#include <algorithm>
#include <limits>
#include <vector>

#include "lanes.hpp"
#include "threads.hpp"

namespace goc {
namespace {

constexpr std::size_t kRows = 16;  // fitted together, from one padded copy

void fit_rows(const float* image, const Lens& lens, int radius, float agree, int fewest, std::size_t begin,
              std::size_t end, float* normals) {
  const std::size_t width = lens.width, padded = (width + 15) / 16 * 16, pitch = padded + 2 * radius;
  const int around = static_cast<int>(end - begin) + 2 * radius;
  std::vector<float> depth(pitch * around, std::numeric_limits<float>::quiet_NaN()), out(3 * padded);
  std::vector<const float*> rows(around);
  for (int r = 0; r < around; ++r) {
    const std::ptrdiff_t y = static_cast<std::ptrdiff_t>(begin) + r - radius;
    rows[r] = depth.data() + pitch * r;
    if (y >= 0 && y < lens.height) std::copy_n(image + y * width, width, depth.data() + pitch * r + radius);
  }
  float* const normal[3] = {out.data(), out.data() + padded, out.data() + 2 * padded};
  for (std::size_t y = begin; y < end; ++y) {
    const FitRow row{rows.data() + (y - begin), lens.width, radius, agree, static_cast<float>(fewest),
                     lens.fx, lens.fy, lens.cx, static_cast<float>(y) + 0.5f - lens.cy};
    kernels().plane_normal_row(row, normal);
    for (std::size_t x = 0; x < width; ++x)
      for (int axis = 0; axis < 3; ++axis) normals[3 * (y * width + x) + axis] = normal[axis][x];
  }
}

}  // namespace

void plane_normals(const float* depth, const Lens& lens, int radius, float agree, int fewest, float* normals) {
  parallel_for(lens.height, kRows, [&](std::size_t begin, std::size_t end) {
    fit_rows(depth, lens, radius, agree, fewest, begin, end, normals);
  });
}

}  // namespace goc
