// The only file that knows Python: arrays are checked here once, kernels see plain pointers.
#include <nanobind/nanobind.h>

#include "threads.hpp"

namespace nb = nanobind;

namespace goc {
void bind_camera(nb::module_& module);
void bind_depth_gaps(nb::module_& module);
void bind_fuse(nb::module_& module);
void bind_losses(nb::module_& module);
void bind_multiview(nb::module_& module);
void bind_noise(nb::module_& module);
void bind_raster(nb::module_& module);
void bind_raycast(nb::module_& module);
void bind_register(nb::module_& module);
void bind_simplify(nb::module_& module);
void bind_stereo(nb::module_& module);
}

NB_MODULE(_native, module) {
  module.doc() = "goc's C++ kernels";
  nb::set_leak_warnings(false);  // module-level workspaces live until the interpreter ends, on purpose
  module.def("thread_count", &goc::thread_count, "Threads that the kernels use.");
  module.def("set_thread_count", &goc::set_thread_count, nb::arg("count"), "Use `count` threads from now on.");
  goc::bind_camera(module);
  goc::bind_depth_gaps(module);
  goc::bind_fuse(module);
  goc::bind_losses(module);
  goc::bind_multiview(module);
  goc::bind_noise(module);
  goc::bind_raster(module);
  goc::bind_raycast(module);
  goc::bind_register(module);
  goc::bind_simplify(module);
  goc::bind_stereo(module);
}
