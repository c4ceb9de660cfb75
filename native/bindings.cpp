// The only file that knows Python: arrays are checked here once, kernels see plain pointers.
#include <nanobind/nanobind.h>

#include "threads.hpp"

namespace nb = nanobind;

void bind_fuse(nb::module_& module);

NB_MODULE(_native, module) {
  module.doc() = "goc's C++ kernels";
  module.def("thread_count", &goc::thread_count, "Threads that the kernels use.");
  module.def("set_thread_count", &goc::set_thread_count, nb::arg("count"), "Use `count` threads from now on.");
  bind_fuse(module);
}
