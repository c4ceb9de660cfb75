// Fusion and its isosurface, as Python sees them.
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>

#include <optional>
#include <utility>
#include <vector>

#include "arrays.hpp"
#include "cells.hpp"
#include "fuse.hpp"
#include "isosurface.hpp"

namespace goc {
namespace {

using Blocks = nb::ndarray<const std::int32_t, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;
using Ids = nb::ndarray<const std::int16_t, nb::shape<-1, -1>, nb::c_contig, nb::device::cpu>;
using Colours = nb::ndarray<const std::uint8_t, nb::shape<-1, -1, 3>, nb::c_contig, nb::device::cpu>;
using Sums = nb::ndarray<float, nb::shape<kSums, -1, 8, 8, 8>, nb::c_contig, nb::device::cpu>;
using Values = nb::ndarray<const float, nb::shape<-1, 8, 8, 8>, nb::c_contig, nb::device::cpu>;

template <typename Array>
void check_size(const Array& image, const Camera& camera, const char* what) {
  check(image.shape(0) == (std::size_t)camera.height && image.shape(1) == (std::size_t)camera.width, what);
}

DepthView depth_view(const Plane& depth, const Plane& slope, const std::optional<Colours>& colours,
                     const std::optional<Ids>& ids, const Camera& camera) {
  check_size(depth, camera, "depth must have the camera's height and width");
  check_size(slope, camera, "slope must have the camera's height and width");
  if (colours) check_size(*colours, camera, "colours must have the camera's height and width");
  if (ids) check_size(*ids, camera, "ids must have the camera's height and width");
  return {camera, depth.data(), slope.data(), ids ? ids->data() : nullptr, colours ? colours->data() : nullptr};
}

void bound_fuse_view(nb::ndarray<const double, nb::shape<5>, nb::c_contig, nb::device::cpu> lattice, Blocks blocks,
                     Plane depth, Plane slope, std::optional<Colours> colours, const Camera& camera,
                     std::optional<Ids> ids, int wanted, Sums sums) {
  const DepthView view = depth_view(depth, slope, colours, ids, camera);
  check(depth.size() >= 2, "an image needs two pixels");  // gather_short, gather_rgb
  check(blocks.shape(0) == sums.shape(1), "one set of sums a block");
  const double* l = lattice.data();
  const Lattice frame{{l[0], l[1], l[2]}, l[3], l[4]};
  nb::gil_scoped_release unlocked;
  fuse_view(frame, blocks.data(), blocks.shape(0), view, wanted, sums.data());
}

void bound_depth_slope(Plane depth, const Camera& camera, int radius, double agree, int fewest, PlaneOut slope) {
  check_size(depth, camera, "depth must have the camera's height and width");
  check_size(slope, camera, "slope must have the camera's height and width");
  check(radius >= 1 && radius <= 8, "radius must be 1 to 8 pixels");
  const Lens lens = camera.lens();
  nb::gil_scoped_release unlocked;
  depth_slope(depth.data(), lens, radius, agree, fewest, slope.data());
}

template <typename T, std::size_t columns>
nb::ndarray<nb::numpy, T, nb::ndim<2>> rows(std::vector<T>&& values) {
  auto* kept = new std::vector<T>(std::move(values));
  nb::capsule owner(kept, [](void* p) noexcept { delete static_cast<std::vector<T>*>(p); });
  return {kept->data(), {kept->size() / columns, columns}, owner};
}

auto bound_count_cells(Plane depth, Plane slope, std::optional<Ids> ids, const Camera& camera, double cell) {
  const DepthView view = depth_view(depth, slope, std::nullopt, ids, camera);
  check(cell > 0, "cells need an edge");
  std::vector<std::uint64_t> keys;
  std::vector<std::int64_t> hits;
  {
    nb::gil_scoped_release unlocked;
    count_cells(view, cell, keys, hits);
  }
  return std::make_pair(rows<std::uint64_t, 1>(std::move(keys)), rows<std::int64_t, 1>(std::move(hits)));
}

auto bound_isosurface(Blocks blocks, Values values) {
  check(blocks.shape(0) == values.shape(0), "one set of values a block");
  Isosurface surface;
  {
    nb::gil_scoped_release unlocked;
    surface = isosurface(blocks.data(), blocks.shape(0), values.data());
  }
  return std::make_pair(rows<std::int64_t, 2>(std::move(surface.edges)),
                        rows<std::int32_t, 3>(std::move(surface.faces)));
}

}  // namespace

void bind_fuse(nb::module_& module) {
  module.attr("FUSE_SUMS") = static_cast<int>(kSums);
  module.def("fuse_view", &bound_fuse_view, nb::arg("lattice"), nb::arg("blocks"), nb::arg("depth"), nb::arg("slope"),
             nb::arg("colours").none(), nb::arg("camera"), nb::arg("ids").none(), nb::arg("wanted"),
             nb::arg("sums").noconvert(), "Add one depth image to the sums of sparse voxel blocks.");
  module.def("depth_slope", &bound_depth_slope, nb::arg("depth"), nb::arg("camera"), nb::arg("radius"), nb::arg("agree"),
             nb::arg("fewest"), nb::arg("slope").noconvert(), "Cosine between rays and the surface seen in a depth image.");
  module.def("count_cells", &bound_count_cells, nb::arg("depth"), nb::arg("slope"), nb::arg("ids").none(), nb::arg("camera"),
             nb::arg("cell"), "Cells that pixels fall into, by id: keys and numbers.");
  module.def("isosurface", &bound_isosurface, nb::arg("blocks"), nb::arg("values"),
             "Zero level over sparse voxel blocks: lattice edges (v, 2) and faces (t, 3).");
}

}  // namespace goc
