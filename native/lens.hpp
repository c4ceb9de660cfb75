// A pinhole camera without a place.
#pragma once

namespace goc {

// Pixel (x, y) is seen along ((x + ½ − cx)/fx, (y + ½ − cy)/fy, 1).
struct Lens {
  float fx, fy, cx, cy;
  int width, height;
};

}  // namespace goc
