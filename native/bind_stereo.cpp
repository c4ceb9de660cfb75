// Python face of stereo: photographs are stacked on one raster, views are worked on in parallel.
#include <utility>
#include <vector>

#include <nanobind/stl/vector.h>

#include "arrays.hpp"
#include "stereo.hpp"
#include "threads.hpp"

namespace goc {
namespace {

using Indices = nb::ndarray<const std::int32_t, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Bytes = nb::ndarray<std::uint8_t, nb::ndim<3>, nb::c_contig, nb::device::cpu>;
using Stack = nb::ndarray<float, nb::ndim<4>, nb::c_contig, nb::device::cpu>;
using StackIn = nb::ndarray<const float, nb::ndim<4>, nb::c_contig, nb::device::cpu>;

Photos stacked(Image greys, std::vector<Camera> cameras) {
  check(cameras.size() == greys.shape(0), "every photograph needs a camera");
  for (const Camera& camera : cameras)
    check(camera.width <= (int)greys.shape(2) && camera.height <= (int)greys.shape(1),
          "a photograph does not fit its raster");
  return make_photos(greys.data(), std::move(cameras), (int)greys.shape(2), (int)greys.shape(1));
}

template <class Array>
void check_raster(const Photos& photos, const Array& array) {
  const bool same = (int)array.shape(0) == photos.count && (int)array.shape(1) == photos.height &&
                    (int)array.shape(2) == photos.width;
  check(same, "arrays must be (views, height, width …) like the photographs");
}

Neighbours check_neighbours(const Photos& photos, const Indices& indices, int first, int last) {
  check((int)indices.shape(0) == photos.count, "neighbours must have a row for each photograph");
  for (std::size_t i = 0; i < indices.size(); ++i)
    check(indices.data()[i] >= -1 && indices.data()[i] < photos.count, "a neighbour is not among the photographs");
  check(0 <= first && first <= last && last <= photos.count, "views must lie within the photographs");
  return {indices.data(), (int)indices.shape(1)};
}

template <class Body>
void each_view(int first, int last, const Body& body) {
  nb::gil_scoped_release release;
  parallel_for(last - first, 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t v = begin; v < end; ++v) body(first + static_cast<int>(v));
  });
}

void sweep(const Photos& photos, int first, int last, Indices neighbours, In<kAny, 2> ranges, int planes,
           float step_penalty, float jump_penalty, ImageOut inverse, ImageOut costs) {
  check_raster(photos, inverse), check_raster(photos, costs);
  check((int)ranges.shape(0) == photos.count, "ranges must have a row for each photograph");
  check(planes >= 16 && planes % 16 == 0, "planes must be a multiple of 16");
  const Neighbours around = check_neighbours(photos, neighbours, first, last);
  each_view(first, last, [&](int v) {
    const float* range = ranges.data() + 2 * v;
    sweep_view(photos, v, around, range[0], range[1], {planes, step_penalty, jump_penalty},
               inverse.data() + photos.pixel(v, 0, 0), costs.data() + photos.pixel(v, 0, 0));
  });
}

void refine(const Photos& photos, int first, int last, Indices neighbours, In<kAny> steps, int sweeps,
            float prior_weight, std::uint64_t seed, Stack planes, ImageOut costs) {
  check_raster(photos, planes), check_raster(photos, costs);
  check(planes.shape(3) == 3, "planes must have three numbers a pixel");
  check((int)steps.shape(0) == photos.count, "steps must have one number for each photograph");
  const Neighbours around = check_neighbours(photos, neighbours, first, last);
  each_view(first, last, [&](int v) {
    const RefineSettings settings{sweeps, prior_weight, seed};
    refine_view(photos, v, around, steps.data()[v], settings, planes.data() + 3 * photos.pixel(v, 0, 0),
                costs.data() + photos.pixel(v, 0, 0));
  });
}

void agree(const Photos& photos, int first, int last, Indices neighbours, StackIn planes, float pixels, float relative,
           ImageOut inverse, Bytes agreeing, Bytes against) {
  check_raster(photos, planes), check_raster(photos, inverse);
  check_raster(photos, agreeing), check_raster(photos, against);
  check(planes.shape(3) == 3, "planes must have three numbers a pixel");
  const Neighbours around = check_neighbours(photos, neighbours, first, last);
  each_view(first, last, [&](int v) {
    const std::size_t at = photos.pixel(v, 0, 0);
    agree_view(photos, v, around, planes.data(), {pixels, relative}, inverse.data() + at, agreeing.data() + at,
               against.data() + at);
  });
}

}  // namespace

void bind_stereo(nb::module_& module) {
  nb::class_<Photos>(module, "Photos", "Grey photographs (0 to 255) with their cameras, ready to be sampled.")
      .def("__init__", [](Photos* self, Image greys, std::vector<Camera> cameras) {
             new (self) Photos(stacked(greys, std::move(cameras)));
           },
           nb::arg("greys"), nb::arg("cameras"));
  module.def("stereo_sweep", &sweep, nb::arg("photos"), nb::arg("first"), nb::arg("last"), nb::arg("neighbours"),
             nb::arg("ranges"), nb::arg("planes"), nb::arg("step_penalty"), nb::arg("jump_penalty"), nb::arg("inverse"),
             nb::arg("costs"), "Inverse depth of views first to last by plane sweep and semi-global smoothing.");
  module.def("stereo_refine", &refine, nb::arg("photos"), nb::arg("first"), nb::arg("last"), nb::arg("neighbours"),
             nb::arg("steps"), nb::arg("sweeps"), nb::arg("prior_weight"), nb::arg("seed"), nb::arg("planes"),
             nb::arg("costs"), "Slanted planes of views first to last, in place.");
  module.def("stereo_agree", &agree, nb::arg("photos"), nb::arg("first"), nb::arg("last"), nb::arg("neighbours"),
             nb::arg("planes"), nb::arg("pixels"), nb::arg("relative"), nb::arg("inverse"), nb::arg("agreeing"),
             nb::arg("against"), "How many views agree with each pixel's plane, and the mean of their inverse depths.");
}

}  // namespace goc
