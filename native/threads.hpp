// A fixed pool of threads for loops whose iterations write to separate places.
#pragma once
#include <cstddef>
#include <functional>

namespace goc {

// Threads that parallel_for uses, the caller included.
int thread_count();
void set_thread_count(int count);

// Calls body(begin, end) over [0, size) in chunks of `grain`, in any order and on any thread. Results must not depend
// on which thread ran a chunk: that is what keeps every stage bit-equal for any number of threads.
// The first exception thrown by a chunk is rethrown in the caller. Not reentrant: a body must not call parallel_for.
void parallel_for(std::size_t size, std::size_t grain, const std::function<void(std::size_t, std::size_t)>& body);

}  // namespace goc
