// Intrinsics of a view.
#pragma once

namespace goc {

// Pixel (x, y) is seen along ((x + ½ − cx)/fx, (y + ½ − cy)/fy, 1).
struct Lens {
  int width, height;
  float fx, fy, cx, cy;
};

}  // namespace goc
