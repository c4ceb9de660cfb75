// Python face of the rasteriser.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/vector.h>

#include <mutex>
#include <optional>
#include <stdexcept>
#include <utility>
#include <vector>

#include "arrays.hpp"
#include "raster.hpp"

namespace nb = nanobind;

namespace goc {
namespace {

// The arrays of n splats, checked together.
struct Splats {
  In<kAny, 3> means;
  In<kAny, 4> quats;
  In<kAny, 3> log_scales;
  In<kAny> opacity_logits;

  SplatArrays arrays() const {
    const std::size_t n = means.shape(0);
    if (quats.shape(0) != n || log_scales.shape(0) != n || opacity_logits.shape(0) != n)
      throw std::invalid_argument("means, quats, log_scales and opacity_logits differ in length");
    return {means.data(), quats.data(), log_scales.data(), opacity_logits.data(), n};
  }
};

// What is blended, with the arrays behind it.
struct ChannelArrays {
  std::optional<Plane> features;
  std::optional<In<kAny, kAny, 3>> sh;
  bool planes;

  // Checked against the number of splats; the eye is where `view` looks from.
  Channels channels(std::size_t splats, const float* view) const {
    Channels out;
    check(features || sh, "nothing to blend");
    if (features) {
      check(features->shape(0) == splats, "channels must have one row a splat");
      out.features = features->data(), out.feature_count = (int)features->shape(1);
    }
    if (sh) {
      const std::size_t k = sh->shape(1);
      check(sh->shape(0) == splats, "sh must have one row a splat");
      check(k == 1 || k == 4 || k == 9 || k == 16, "sh must have (degree + 1)² rows of degree 0 to 3");
      out.sh = sh->data(), out.harmonics = (int)k, out.planes = planes;
    }
    for (int k = 0; k < 3; ++k)
      out.eye[k] = -(view[k] * view[3] + view[4 + k] * view[7] + view[8 + k] * view[11]);
    return out;
  }
};

// The planes of images (c h w), one after another.
template <class T, class Images>
std::vector<T*> planes_of(const Images& images, const DrawCamera& camera) {
  std::vector<T*> out;
  for (const auto& image : images) {
    check(image.shape(1) == (std::size_t)camera.height && image.shape(2) == (std::size_t)camera.width,
          "images must be (channels, height, width)");
    for (std::size_t c = 0; c < image.shape(0); ++c) out.push_back(image.data() + c * image.shape(1) * image.shape(2));
  }
  return out;
}

// Rasters of views that Python forgot, for the next ones: a step allocates no buffers.
struct Shelf {
  std::mutex lock;
  std::vector<Raster> idle;
};
Shelf& shelf() {
  static Shelf* kept = new Shelf;  // outlives every view, whatever order things end in
  return *kept;
}

// A raster off the shelf, back there when Python forgets the view. Not a Python destructor: a Ctrl-C that arrives in
// one is swallowed.
class LentRaster : public Raster {
 public:
  LentRaster() : Raster(taken()) {}
  LentRaster(const LentRaster&) = delete;
  ~LentRaster() {
    std::lock_guard held(shelf().lock);
    shelf().idle.push_back(std::move(*this));
  }

 private:
  static Raster taken() {
    std::lock_guard held(shelf().lock);
    if (shelf().idle.empty()) return {};
    Raster out = std::move(shelf().idle.back());
    shelf().idle.pop_back();
    return out;
  }
};

using Images = std::vector<Image>;
using ImagesOut = std::vector<ImageOut>;
using Gradients = std::vector<std::optional<Image>>;

void forward(LentRaster& self, const Splats& splats, const ChannelArrays& arrays, const Camera& seen_by,
             const ImagesOut& images, PlaneOut alpha) {
  check(seen_by.width <= 32767 && seen_by.height <= 32767, "width and height must be in 1..32767");
  const DrawCamera camera = seen_by.as<float>();
  const SplatArrays given = splats.arrays();
  const Channels channels = arrays.channels(given.size, camera.cam_from_world);
  const auto planes = planes_of<float>(images, camera);
  check(planes.size() == (std::size_t)channels.count() && !planes.empty(), "as many planes as channels are needed");
  check(alpha.shape(0) == (std::size_t)camera.height && alpha.shape(1) == (std::size_t)camera.width,
        "alpha must be (height, width)");
  nb::gil_scoped_release release;
  self.forward(given, channels, camera, planes.data(), alpha.data());
}

void backward(LentRaster& self, const Splats& splats, const ChannelArrays& arrays, const Images& images, Plane alpha,
              const Gradients& image_grads, std::optional<Plane> alpha_grad, std::optional<PlaneOut> means,
              std::optional<PlaneOut> quats, std::optional<PlaneOut> log_scales, std::optional<Flat> logits,
              std::optional<ImageOut> sh, std::optional<PlaneOut> features) {
  const SplatArrays given = splats.arrays();
  const DrawCamera& camera = self.camera();
  const Channels channels = arrays.channels(given.size, camera.cam_from_world);
  const auto planes = planes_of<const float>(images, camera);
  check(planes.size() == (std::size_t)channels.count(), "as many planes as channels are needed");
  check(images.size() == image_grads.size(), "every image needs a gradient, or None");
  std::vector<const float*> grads;
  for (std::size_t k = 0; k < images.size(); ++k) {
    for (int axis = 0; image_grads[k] && axis < 3; ++axis)
      check(image_grads[k]->shape(axis) == images[k].shape(axis), "a gradient differs from its image");
    const std::size_t size = images[k].shape(1) * images[k].shape(2);
    for (std::size_t c = 0; c < images[k].shape(0); ++c)
      grads.push_back(image_grads[k] ? image_grads[k]->data() + c * size : nullptr);
  }
  const auto rows = [&](const auto& a, std::size_t width) {
    check(a.shape(0) == given.size && a.shape(1) == width, "a gradient has the wrong shape");
  };
  SplatGradients out{};
  if (means) {
    check(quats && log_scales && logits, "gradients of the splats come together");
    rows(*means, 3), rows(*quats, 4), rows(*log_scales, 3);
    check(logits->shape(0) == given.size, "a gradient has the wrong shape");
    out = {means->data(), quats->data(), log_scales->data(), logits->data()};
  }
  check(sh.has_value() == (channels.sh != nullptr), "sh needs a gradient");
  check(features.has_value() == (channels.features != nullptr), "features need a gradient");
  if (sh) rows(*sh, channels.harmonics), check(sh->shape(2) == 3, "a gradient has the wrong shape");
  if (features) rows(*features, channels.feature_count);
  const ChannelGradients channels_out{sh ? sh->data() : nullptr, features ? features->data() : nullptr};
  const float* upstream = alpha_grad ? alpha_grad->data() : nullptr;
  nb::gil_scoped_release release;
  self.backward(given, channels, planes.data(), alpha.data(), grads.data(), upstream, means ? &out : nullptr,
                channels_out);
}

}  // namespace

void bind_raster(nb::module_& module) {
  module.attr("MAX_ALPHA") = kMaxAlpha;
  module.attr("MIN_ALPHA") = kMinAlpha;
  module.attr("MIN_TRANSMITTANCE") = kMinTransmittance;
  module.attr("NEAR") = kNear;
  module.attr("DILATION") = kDilation;
  module.def("simd_level", [] { return kernels().name; }, "Instruction set that the kernels use on this machine.");

  nb::class_<Splats>(module, "Splats", "The arrays of n splats: means (n 3), quats (n 4), log_scales (n 3), logits (n).")
      .def("__init__",
           [](Splats* self, In<kAny, 3> means, In<kAny, 4> quats, In<kAny, 3> log_scales, In<kAny> logits) {
             new (self) Splats{means, quats, log_scales, logits};
             self->arrays();
           });

  nb::class_<ChannelArrays>(module, "Channels",
                            "What is blended: with sh (n k 3), colour (3) and planes (4) or depth (1) first; then "
                            "features (n f).")
      .def("__init__",
           [](ChannelArrays* self, std::optional<Plane> features, std::optional<In<kAny, kAny, 3>> sh, bool planes) {
             new (self) ChannelArrays{features, sh, planes};
           },
           nb::arg("features").none(), nb::arg("sh").none() = nb::none(), nb::arg("planes") = false);

  nb::class_<LentRaster>(module, "Raster", "One rendered view and the buffers behind it, which serve another view once it is forgotten.")
      .def(nb::init<>())
      .def_prop_ro("records", &Raster::records, "(tile, splat) pairs of the last view.")
      .def_prop_ro("blocks", &Raster::blocks, "(record, block of 4×4 pixels) pairs of the last view.")
      .def_prop_ro("bytes", &Raster::bytes, "Memory of the buffers; grows to that of the largest view and stays.")
      .def("forward", &forward, nb::arg("splats"), nb::arg("channels"), nb::arg("camera"), nb::arg("images"),
           nb::arg("alpha"), "Render the channels into the planes of images (c h w), taken together, and alpha (h w).")
      .def("backward", &backward, nb::arg("splats"), nb::arg("channels"), nb::arg("images"), nb::arg("alpha"),
           nb::arg("image_grads"), nb::arg("alpha_grad").none(), nb::arg("means").none(), nb::arg("quats").none(),
           nb::arg("log_scales").none(), nb::arg("logits").none(), nb::arg("sh").none(), nb::arg("features").none(),
           "Gradients of the last forward, every row; an image without a gradient has None.")
      .def("median", [](const LentRaster& self, nb::ndarray<std::int32_t, nb::ndim<2>, nb::c_contig, nb::device::cpu> out) {
        check(out.shape(0) == (std::size_t)self.height() && out.shape(1) == (std::size_t)self.width(),
              "out must be (height, width) of the last view");
        self.median(out.data());
      }, "Splat at which each pixel of the last view turns half opaque; -1 where none does.");
  module.def("idle_rasters", [] {
    std::lock_guard held(shelf().lock);
    std::vector<std::size_t> bytes;
    for (const Raster& raster : shelf().idle) bytes.push_back(raster.bytes());
    return bytes;
  }, "Bytes of each raster that waits for a view.");
  module.def("forget_idle_rasters", [] {
    std::lock_guard held(shelf().lock);
    shelf().idle.clear();
  }, "Free the memory of rasters that wait for a view.");
}

}  // namespace goc
