#include "stereo.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "lanes.hpp"

namespace goc {
namespace {

constexpr float kLarge = 1e9f;
constexpr float kEdge = 10.0f;  // of 255: a step of grey across which a jump of depth costs half

// What four paths have reached at the pixels of this row and of the one before: a large number, the planes, a large
// number, the least of them.
struct Paths {
  int width, stride;
  std::vector<float> reached;

  Paths(int width, int planes) : width(width), stride(planes + 3), reached(std::size_t(8) * width * stride, kLarge) {}
  float* at(int row, int path, int x) {
    return reached.data() + (static_cast<std::size_t>(row * 4 + path) * width + x) * stride;
  }
};

// One view's window statistics, and the buffers of a plane's warped images.
struct Sweep {
  const Photos& photos;
  const Camera& camera;
  int width, height, planes;
  std::vector<float> reference, mean, scale, warped, inside, costs, best, scratch, block, volume, total;

  Sweep(const Photos& photos, int view, int planes)
      : photos(photos), camera(photos.cameras[view]), width(camera.width), height(camera.height), planes(planes) {
    const std::size_t pixels = static_cast<std::size_t>(width) * height;
    reference.resize(pixels), mean.resize(pixels), scale.resize(pixels), warped.resize(pixels), inside.resize(pixels);
    costs.resize(width), best.resize(3 * pixels), scratch.resize(3 * (width + 2 * kWindow)), block.resize(16 * pixels);
    volume.resize(pixels * planes), total.assign(pixels * planes, 0.0f);
    for (int y = 0; y < height; ++y)
      std::copy_n(photos.greys.data() + photos.pixel(view, 0, y), width, reference.data() + at(0, y));
    describe_windows();
  }

  std::size_t at(int x, int y) const { return static_cast<std::size_t>(y) * width + x; }

  void describe_windows() {
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x) {
        float sum = 0, squares = 0;
        for (int dy = -kWindow; dy <= kWindow; ++dy)
          for (int dx = -kWindow; dx <= kWindow; ++dx) {
            const float grey = reference[at(std::clamp(x + dx, 0, width - 1), std::clamp(y + dy, 0, height - 1))];
            sum += grey, squares += grey * grey;
          }
        constexpr float share = 1.0f / ((2 * kWindow + 1) * (2 * kWindow + 1));
        const float middle = sum * share, variance = std::max(0.0f, squares * share - middle * middle);
        mean[at(x, y)] = middle;
        scale[at(x, y)] = 1.0f / std::sqrt(variance + kGreyNoise * kGreyNoise);
      }
  }

  // Costs of the plane at inverse depth q against one neighbour, into the best three.
  void match(int other, float q) {
    const Camera& there = photos.cameras[other];
    const Transfer to = transfer(camera, there);
    const Kernels& kernel = kernels();
    WarpedRow warp{photos.quads.data() + photos.pixel(other, 0, 0), photos.width, static_cast<float>(there.width - 1),
                   static_cast<float>(there.height - 1), {}, {}};
    for (int y = 0; y < height; ++y) {
      for (int k = 0; k < 3; ++k) {
        warp.start[k] = to.m[3 * k + 1] * static_cast<float>(y) + to.m[3 * k + 2] + q * to.t[k];
        warp.step[k] = to.m[3 * k];
      }
      kernel.warp_row(warp, width, warped.data() + at(0, y), inside.data() + at(0, y));
    }
    const std::size_t pixels = mean.size();
    for (int y = 0; y < height; ++y) {
      const float *rows[2 * kWindow + 1], *warped_rows[2 * kWindow + 1];
      for (int k = -kWindow; k <= kWindow; ++k) {
        const std::size_t row = at(0, std::clamp(y + k, 0, height - 1));
        rows[k + kWindow] = reference.data() + row, warped_rows[k + kWindow] = warped.data() + row;
      }
      const std::size_t row = at(0, y);
      kernel.match_row(rows, warped_rows, mean.data() + row, scale.data() + row, inside.data() + row, width,
                       scratch.data(), costs.data());
      float* first = best.data() + row;
      kernel.keep_best(costs.data(), width, first, first + pixels, first + 2 * pixels);
    }
  }

  // Costs of all planes, a pixel's side by side.
  void fill(int view, Neighbours neighbours, float far, float step) {
    const std::size_t pixels = mean.size();
    for (int plane = 0; plane < planes; ++plane) {
      std::fill(best.begin(), best.end(), 1.0f);
      for (int k = 0; k < neighbours.stride; ++k) {
        const int other = neighbours.views[static_cast<std::size_t>(view) * neighbours.stride + k];
        if (other >= 0) match(other, far + step * static_cast<float>(plane));
      }
      float* row = block.data() + static_cast<std::size_t>(plane % 16) * pixels;
      for (std::size_t i = 0; i < pixels; ++i)
        row[i] = (best[i] + best[pixels + i] + best[2 * pixels + i]) * (1.0f / 3.0f);
      if (plane % 16 != 15) continue;
      for (std::size_t i = 0; i < pixels; ++i)
        for (int k = 0; k < 16; ++k) volume[i * planes + (plane - 15) + k] = block[k * pixels + i];
    }
  }

  // Four of the eight paths, from the top left (or, backwards, from the bottom right).
  void smooth(const SweepSettings& settings, bool backwards) {
    Paths paths(width, planes);
    const int sign = backwards ? -1 : 1;
    for (int row = 0; row < height; ++row)
      for (int column = 0; column < width; ++column) {
        const int x = backwards ? width - 1 - column : column, y = backwards ? height - 1 - row : row;
        for (int path = 0; path < 4; ++path) {
          // In the order of the scan: from the left, then from above left, above, above right.
          const int from_x = x + sign * (path == 0 ? -1 : path - 2), from_y = y - (path == 0 ? 0 : sign);
          const float* cost = volume.data() + at(x, y) * planes;
          float *out = paths.at(row % 2, path, x), *sums = total.data() + at(x, y) * planes, *least = out + planes + 2;
          if (from_x < 0 || from_x >= width || from_y < 0 || from_y >= height) {  // nothing came before
            std::fill_n(out + 1, planes, 0.0f);
            *least = kernels().path_step(cost, out + 1, 0.0f, 0.0f, 0.0f, planes, out + 1, sums);
            continue;
          }
          const float* from = paths.at(path == 0 ? row % 2 : 1 - row % 2, path, from_x);
          const float contrast = std::abs(reference[at(x, y)] - reference[at(from_x, from_y)]);
          const float jump = std::max(settings.step_penalty, settings.jump_penalty * kEdge / (kEdge + contrast));
          *least = kernels().path_step(cost, from + 1, from[planes + 2], settings.step_penalty, jump, planes, out + 1,
                                       sums);
        }
      }
  }

  // The cheapest plane of a pixel, between planes by a parabola.
  float winner(std::size_t pixel, float& cost) const {
    const float* sums = total.data() + pixel * planes;
    const int plane = static_cast<int>(std::min_element(sums, sums + planes) - sums);
    cost = volume[pixel * planes + plane];
    if (plane == 0 || plane == planes - 1) return static_cast<float>(plane);
    const float bend = sums[plane - 1] + sums[plane + 1] - 2 * sums[plane];
    return static_cast<float>(plane) + (bend > 1e-6f ? 0.5f * (sums[plane - 1] - sums[plane + 1]) / bend : 0.0f);
  }
};

}  // namespace

Photos make_photos(const float* greys, std::vector<Camera> cameras, int width, int height) {
  const int count = static_cast<int>(cameras.size());
  Photos photos{count, width, height, {}, {}, std::move(cameras)};
  photos.greys.assign(greys, greys + static_cast<std::size_t>(count) * width * height);
  photos.quads.resize(photos.greys.size());
  for (int view = 0; view < count; ++view) {
    const Camera& camera = photos.cameras[view];
    const auto byte = [&](int x, int y) {
      const float grey = greys[photos.pixel(view, std::min(x, camera.width - 1), std::min(y, camera.height - 1))];
      return static_cast<std::uint32_t>(std::clamp(grey + 0.5f, 0.0f, 255.0f));
    };
    for (int y = 0; y < camera.height; ++y)
      for (int x = 0; x < camera.width; ++x)
        photos.quads[photos.pixel(view, x, y)] =
            byte(x, y) | byte(x + 1, y) << 8 | byte(x, y + 1) << 16 | byte(x + 1, y + 1) << 24;
  }
  return photos;
}

Transfer transfer(const Camera& from, const Camera& to) {
  const double *a = from.cam_from_world, *b = to.cam_from_world;
  double rotation[9], shift[3];  // to_from = b · a⁻¹
  for (int i = 0; i < 3; ++i) {
    shift[i] = b[4 * i + 3];
    for (int j = 0; j < 3; ++j) {
      rotation[3 * i + j] = b[4 * i] * a[4 * j] + b[4 * i + 1] * a[4 * j + 1] + b[4 * i + 2] * a[4 * j + 2];
      shift[i] -= rotation[3 * i + j] * a[4 * j + 3];
    }
  }
  Transfer found;
  double rays[9], moved[3];  // axes of the target camera, before its lens
  for (int i = 0; i < 3; ++i) {
    rays[3 * i] = rotation[3 * i] / from.fx;
    rays[3 * i + 1] = rotation[3 * i + 1] / from.fy;
    rays[3 * i + 2] = rotation[3 * i + 2] + rays[3 * i] * (0.5 - from.cx) + rays[3 * i + 1] * (0.5 - from.cy);
    moved[i] = shift[i];
  }
  const auto project = [&](const double* x, int stride, float* out, int out_stride) {
    out[0] = static_cast<float>(to.fx * x[0] + (to.cx - 0.5) * x[2 * stride]);
    out[out_stride] = static_cast<float>(to.fy * x[stride] + (to.cy - 0.5) * x[2 * stride]);
    out[2 * out_stride] = static_cast<float>(x[2 * stride]);
  };
  for (int j = 0; j < 3; ++j) project(rays + j, 3, found.m + j, 3);
  project(moved, 1, found.t, 1);
  return found;
}

void sweep_view(const Photos& photos, int view, Neighbours neighbours, float far, float near,
                const SweepSettings& settings, float* inverse, float* costs) {
  Sweep sweep(photos, view, settings.planes);
  const float step = (near - far) / static_cast<float>(settings.planes - 1);
  sweep.fill(view, neighbours, far, step);
  sweep.smooth(settings, false);
  sweep.smooth(settings, true);
  for (int y = 0; y < sweep.height; ++y)
    for (int x = 0; x < sweep.width; ++x) {
      const std::size_t pixel = static_cast<std::size_t>(y) * photos.width + x;
      inverse[pixel] = far + step * sweep.winner(sweep.at(x, y), costs[pixel]);
    }
}

}  // namespace goc
