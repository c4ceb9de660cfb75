// Fusion and its isosurface, as Python sees them.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>

#include <algorithm>
#include <optional>
#include <stdexcept>
#include <utility>
#include <vector>

#include "cells.hpp"
#include "fuse.hpp"
#include "isosurface.hpp"

namespace nb = nanobind;

namespace {

using Blocks = nb::ndarray<const std::int32_t, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;
using Image = nb::ndarray<const float, nb::shape<-1, -1>, nb::c_contig, nb::device::cpu>;
using Ids = nb::ndarray<const std::int16_t, nb::shape<-1, -1>, nb::c_contig, nb::device::cpu>;
using Colours = nb::ndarray<const std::uint8_t, nb::shape<-1, -1, 3>, nb::c_contig, nb::device::cpu>;
using Pinhole = nb::ndarray<const double, nb::shape<16>, nb::c_contig, nb::device::cpu>;
using Sums = nb::ndarray<float, nb::shape<goc::kSums, -1, 8, 8, 8>, nb::c_contig, nb::device::cpu>;
using Values = nb::ndarray<const float, nb::shape<-1, 8, 8, 8>, nb::c_contig, nb::device::cpu>;

template <typename A, typename B>
void same_size(const A& a, const B& b, const char* what) {
  if (a.shape(0) != b.shape(0) || a.shape(1) != b.shape(1)) throw std::invalid_argument(what);
}

// `pinhole`: fx, fy, cx, cy, then the upper three rows of cam_from_world.
goc::DepthView depth_view(Image depth, Image slope, std::optional<Colours> colours, std::optional<Ids> ids, Pinhole pinhole) {
  same_size(depth, slope, "depth and slope differ in size");
  goc::DepthView view{};
  view.height = static_cast<int>(depth.shape(0)), view.width = static_cast<int>(depth.shape(1));
  const double* p = pinhole.data();
  std::copy(p, p + 2, view.focal), std::copy(p + 2, p + 4, view.centre), std::copy(p + 4, p + 16, view.cam_from_world);
  view.depth = depth.data(), view.slope = slope.data();
  if (depth.size() < 2) throw std::invalid_argument("an image needs two pixels");  // gather_short, gather_rgb
  if (colours) {
    same_size(depth, *colours, "depth and colours differ in size");
    view.colours = colours->data();
  }
  if (ids) {
    same_size(depth, *ids, "depth and ids differ in size");
    view.ids = ids->data();
  }
  return view;
}

void bound_fuse_view(nb::ndarray<const double, nb::shape<5>, nb::c_contig, nb::device::cpu> lattice, Blocks blocks, Image depth,
               Image slope, std::optional<Colours> colours, Pinhole pinhole, std::optional<Ids> ids, int wanted, Sums sums) {
  const goc::DepthView view = depth_view(depth, slope, colours, ids, pinhole);
  if (blocks.shape(0) != sums.shape(1)) throw std::invalid_argument("one set of sums a block");
  const double* l = lattice.data();
  const goc::Lattice frame{{l[0], l[1], l[2]}, l[3], l[4]};
  nb::gil_scoped_release unlocked;
  goc::fuse_view(frame, blocks.data(), blocks.shape(0), view, wanted, sums.data());
}

void bound_depth_slope(Image depth, Pinhole pinhole, int radius, double agree, int fewest,
                 nb::ndarray<float, nb::shape<-1, -1>, nb::c_contig, nb::device::cpu> slope) {
  same_size(depth, slope, "depth and slope differ in size");
  if (radius < 1 || radius > 8) throw std::invalid_argument("radius must be 1 to 8 pixels");
  goc::DepthView view{};
  view.height = static_cast<int>(depth.shape(0)), view.width = static_cast<int>(depth.shape(1));
  const double* p = pinhole.data();
  std::copy(p, p + 2, view.focal), std::copy(p + 2, p + 4, view.centre);
  view.depth = depth.data();
  nb::gil_scoped_release unlocked;
  goc::depth_slope(view, radius, agree, fewest, slope.data());
}

template <typename T, std::size_t columns>
nb::ndarray<nb::numpy, T, nb::ndim<2>> rows(std::vector<T>&& values) {
  auto* kept = new std::vector<T>(std::move(values));
  nb::capsule owner(kept, [](void* p) noexcept { delete static_cast<std::vector<T>*>(p); });
  return {kept->data(), {kept->size() / columns, columns}, owner};
}

auto bound_count_cells(Image depth, Image slope, std::optional<Ids> ids, Pinhole pinhole,
                 nb::ndarray<const double, nb::shape<3, 4>, nb::c_contig, nb::device::cpu> world_from_cam, double cell) {
  same_size(depth, slope, "depth and slope differ in size");
  if (!(cell > 0)) throw std::invalid_argument("cells need an edge");
  goc::DepthView view{};
  view.height = static_cast<int>(depth.shape(0)), view.width = static_cast<int>(depth.shape(1));
  const double* p = pinhole.data();
  std::copy(p, p + 2, view.focal), std::copy(p + 2, p + 4, view.centre);
  view.depth = depth.data(), view.slope = slope.data();
  if (ids) {
    same_size(depth, *ids, "depth and ids differ in size");
    view.ids = ids->data();
  }
  std::vector<std::uint64_t> keys;
  std::vector<std::int64_t> hits;
  {
    nb::gil_scoped_release unlocked;
    goc::count_cells(view, world_from_cam.data(), cell, keys, hits);
  }
  return std::make_pair(rows<std::uint64_t, 1>(std::move(keys)), rows<std::int64_t, 1>(std::move(hits)));
}

auto bound_isosurface(Blocks blocks, Values values) {
  if (blocks.shape(0) != values.shape(0)) throw std::invalid_argument("one set of values a block");
  goc::Isosurface surface;
  {
    nb::gil_scoped_release unlocked;
    surface = goc::isosurface(blocks.data(), blocks.shape(0), values.data());
  }
  return std::make_pair(rows<std::int64_t, 2>(std::move(surface.edges)),
                        rows<std::int32_t, 3>(std::move(surface.faces)));
}

}  // namespace

namespace goc {

void bind_fuse(nb::module_& module) {
  module.attr("FUSE_SUMS") = static_cast<int>(goc::kSums);
  module.def("fuse_view", &bound_fuse_view, nb::arg("lattice"), nb::arg("blocks"), nb::arg("depth"), nb::arg("slope"),
             nb::arg("colours").none(), nb::arg("pinhole"), nb::arg("ids").none(), nb::arg("wanted"),
             nb::arg("sums").noconvert(), "Add one depth image to the sums of sparse voxel blocks.");
  module.def("depth_slope", &bound_depth_slope, nb::arg("depth"), nb::arg("pinhole"), nb::arg("radius"), nb::arg("agree"),
             nb::arg("fewest"), nb::arg("slope").noconvert(), "Cosine between rays and the surface seen in a depth image.");
  module.def("count_cells", &bound_count_cells, nb::arg("depth"), nb::arg("slope"), nb::arg("ids").none(), nb::arg("pinhole"),
             nb::arg("world_from_cam"), nb::arg("cell"), "Cells that pixels fall into, by id: keys and numbers.");
  module.def("isosurface", &bound_isosurface, nb::arg("blocks"), nb::arg("values"),
             "Zero level over sparse voxel blocks: lattice edges (v, 2) and faces (t, 3).");
}

}  // namespace goc
