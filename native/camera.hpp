// A posed pinhole camera, as scene/camera.py has it: x right, y down, z forward; pixel (0, 0) is centred at (½, ½).
#pragma once

namespace goc {

// What a kernel needs that stays in the camera's own axes: pixel (x, y) is seen along ((x + ½ − cx)/fx, (y + ½ − cy)/fy, 1).
struct Lens {
  float fx, fy, cx, cy;
  int width, height;
};

// In double for kernels that place things in the world, in single precision for those that draw splats.
template <class Real>
struct CameraOf {
  Real fx, fy, cx, cy;
  int width, height;
  Real cam_from_world[12];  // upper three rows of the rigid pose
  Real world_from_cam[12];  // those of its inverse, as the camera was given them

  // Of every `stride`-th pixel of a row and column.
  Lens lens(int stride, int columns, int rows) const {
    return {static_cast<float>(fx / stride), static_cast<float>(fy / stride), static_cast<float>(cx / stride),
            static_cast<float>(cy / stride), columns, rows};
  }
  Lens lens() const { return lens(1, width, height); }

  template <class Other>
  CameraOf<Other> as() const {
    CameraOf<Other> out{static_cast<Other>(fx), static_cast<Other>(fy), static_cast<Other>(cx), static_cast<Other>(cy),
                        width, height, {}, {}};
    for (int i = 0; i < 12; ++i) {
      out.cam_from_world[i] = static_cast<Other>(cam_from_world[i]);
      out.world_from_cam[i] = static_cast<Other>(world_from_cam[i]);
    }
    return out;
  }
};

using Camera = CameraOf<double>;
using DrawCamera = CameraOf<float>;

// Rows of [R | t] that carry points from the axes of one camera to those of another.
inline void between(const Camera& from, const Camera& to, float* rows) {
  const double *a = to.cam_from_world, *b = from.world_from_cam;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 4; ++j)
      rows[4 * i + j] = static_cast<float>(a[4 * i] * b[j] + a[4 * i + 1] * b[4 + j] + a[4 * i + 2] * b[8 + j] +
                                           (j == 3 ? a[4 * i + 3] : 0.0));
}

}  // namespace goc
