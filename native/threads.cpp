#include "threads.hpp"

#include <algorithm>
#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <exception>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

namespace goc {
namespace {

struct Job {
  const std::function<void(std::size_t, std::size_t)>* body;
  std::size_t size, grain;
  std::atomic<std::size_t> next{0};
  std::atomic<int> running{0};
  std::exception_ptr error;
  std::mutex error_mutex;

  void work() {
    for (;;) {
      const std::size_t begin = next.fetch_add(grain);
      if (begin >= size) return;
      try {
        (*body)(begin, std::min(begin + grain, size));
      } catch (...) {
        std::lock_guard lock(error_mutex);
        if (!error) error = std::current_exception();
        next.store(size);
      }
    }
  }
};

class Pool {
 public:
  explicit Pool(int threads) {
    for (int i = 1; i < threads; ++i) workers_.emplace_back([this] { loop(); });
  }

  ~Pool() {
    {
      std::lock_guard lock(mutex_);
      stopping_ = true;
    }
    wake_.notify_all();
    for (auto& worker : workers_) worker.join();
  }

  int size() const { return static_cast<int>(workers_.size()) + 1; }

  void run(Job& job) {
    {
      std::lock_guard lock(mutex_);
      job.running = static_cast<int>(workers_.size());
      job_ = &job;
      ++generation_;
    }
    wake_.notify_all();
    job.work();
    std::unique_lock lock(mutex_);
    done_.wait(lock, [&] { return job.running == 0; });
    job_ = nullptr;
  }

 private:
  void loop() {
    std::uint64_t seen = 0;
    std::unique_lock lock(mutex_);
    for (;;) {
      wake_.wait(lock, [&] { return stopping_ || generation_ != seen; });
      if (stopping_) return;
      seen = generation_;
      Job* job = job_;
      lock.unlock();
      job->work();
      lock.lock();
      if (--job->running == 0) done_.notify_all();
    }
  }

  std::vector<std::thread> workers_;
  std::mutex mutex_;
  std::condition_variable wake_, done_;
  Job* job_ = nullptr;
  std::uint64_t generation_ = 0;
  bool stopping_ = false;
};

std::mutex pool_mutex;
// Leaked on purpose at exit: joining threads while the interpreter unloads can deadlock.
Pool* pool = nullptr;

Pool& the_pool() {
  if (!pool) pool = new Pool(std::max(1u, std::thread::hardware_concurrency()));
  return *pool;
}

}  // namespace

int thread_count() {
  std::lock_guard lock(pool_mutex);
  return the_pool().size();
}

void set_thread_count(int count) {
  std::lock_guard lock(pool_mutex);
  delete pool;
  pool = new Pool(std::max(1, count));
}

void parallel_for(std::size_t size, std::size_t grain, const std::function<void(std::size_t, std::size_t)>& body) {
  if (size == 0) return;
  std::lock_guard lock(pool_mutex);
  Job job;
  job.body = &body;
  job.size = size;
  job.grain = std::max<std::size_t>(1, grain);
  if (size <= job.grain || the_pool().size() == 1) {
    job.work();
  } else {
    the_pool().run(job);
  }
  if (job.error) std::rethrow_exception(job.error);
}

}  // namespace goc
