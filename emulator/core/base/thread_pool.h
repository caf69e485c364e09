// A pool of worker threads that sleep between calls. Jobs are numbered and must write disjoint
// outputs, so that the result does not depend on which worker runs a job, or when. In a process
// that was forked, which has no threads but one, that one runs all jobs.
#pragma once

#include <pthread.h>
#include <unistd.h>

#include <atomic>
#include <exception>
#include <functional>
#include <mutex>
#include <new>
#include <system_error>
#include <thread>
#include <vector>

#if defined(__SSE2__)
#include <immintrin.h>
#endif

namespace evs {

// Flush denormals to zero on this thread during the lifetime of a FlushDenormals, and restore the
// mode afterwards. An operation on denormals costs up to 70 times a normal one.
class FlushDenormals {
 public:
#if defined(__SSE2__)
  FlushDenormals() : saved_(_mm_getcsr()) { _mm_setcsr(saved_ | 0x8040u); }  // FTZ | DAZ
  ~FlushDenormals() { _mm_setcsr(saved_); }
#elif defined(__aarch64__)
  FlushDenormals() {
    asm volatile("mrs %0, fpcr" : "=r"(saved_));
    asm volatile("msr fpcr, %0" ::"r"(saved_ | (1ull << 24)));
  }
  ~FlushDenormals() { asm volatile("msr fpcr, %0" ::"r"(saved_)); }
#else
  FlushDenormals() {}
  ~FlushDenormals() {}
#endif
  FlushDenormals(const FlushDenormals&) = delete;
  FlushDenormals& operator=(const FlushDenormals&) = delete;

 private:
#if defined(__SSE2__)
  unsigned saved_;
#elif defined(__aarch64__)
  unsigned long long saved_;
#endif
};

// A condition variable. std::condition_variable does the same, but a program that g++ 12 or newer
// compiled with it does not load on a system whose libstdc++ is older.
class Condition {
 public:
  Condition() = default;
  ~Condition() {
    if (!is_abandoned_) pthread_cond_destroy(&condition_);
  }
  Condition(const Condition&) = delete;
  Condition& operator=(const Condition&) = delete;

  void notify_one() { pthread_cond_signal(&condition_); }
  void notify_all() { pthread_cond_broadcast(&condition_); }

  // Wait until `holds()`, which is called with the lock held.
  template <class F>
  void wait(std::unique_lock<std::mutex>& lock, F&& holds) {
    while (!holds()) pthread_cond_wait(&condition_, lock.mutex()->native_handle());
  }

  // Leave it as it is for ever: some that wait are not in this process.
  void abandon() { is_abandoned_ = true; }

 private:
  bool is_abandoned_ = false;
  pthread_cond_t condition_ = PTHREAD_COND_INITIALIZER;
};

class ThreadPool {
 public:
  // threads <= 0 means one for each core of the machine. The calling thread is worker 0.
  explicit ThreadPool(int threads) {
    int cores = static_cast<int>(std::thread::hardware_concurrency());
    count_ = threads > 0 ? threads : (cores > 0 ? cores : 1);
    try {
      for (int worker = 1; worker < count_; worker++) {
        workers_.emplace_back([this, worker] { serve(worker); });
      }
    } catch (const std::system_error&) {
      // no memory for another stack: stop the running threads before throwing
      close();
      throw std::bad_alloc();
    } catch (...) {
      close();
      throw;
    }
  }

  ~ThreadPool() {
    if (!is_forked()) {
      close();
      return;
    }
    // joining or freeing what the other process waits for would not return
    new std::vector<std::thread>(std::move(workers_));
    wake_.abandon();
    done_.abandon();
  }

  ThreadPool(const ThreadPool&) = delete;
  ThreadPool& operator=(const ThreadPool&) = delete;

  int threads() const { return count_; }

  // Call job(index, worker) for every index in [0, jobs) and return when all are done. Rethrows the
  // first exception of any job after all workers have stopped.
  template <class F>
  void run(int jobs, F&& job) {
    if (count_ == 1 || is_forked()) {
      // no worker to share with: callers in several threads do not wait for each other
      FlushDenormals flush;
      for (int index = 0; index < jobs; index++) job(index, 0);
      return;
    }
    std::lock_guard one_caller(callers_);
    auto body = [&job](int index, int worker) { job(index, worker); };
    std::function<void(int, int)> task = std::ref(body);
    next_.store(0, std::memory_order_relaxed);
    error_ = nullptr;
    if (jobs > 1 && count_ > 1) {
      {
        std::lock_guard lock(mutex_);
        task_ = &task;
        jobs_ = jobs;
        generation_++;
      }
      // without the lock, for which woken workers would wait
      wake_.notify_all();
    }
    work(task, jobs, 0);
    if (jobs > 1 && count_ > 1) {
      // spin first: the last jobs mostly end sooner than a thread sleeps and wakes
      for (int spin = 0; spin < SPINS && busy_.load() > 0; spin++) relax();
      std::unique_lock lock(mutex_);
      // do not wait for workers that have not woken yet, as on a busy machine
      task_ = nullptr;
      done_.wait(lock, [this] { return busy_.load() == 0; });
    }
    if (error_) std::rethrow_exception(error_);
  }

 private:
  static constexpr int SPINS = 2000;  // about 30 us

  static void relax() {
#if defined(__x86_64__)
    __builtin_ia32_pause();
#elif defined(__aarch64__)
    asm volatile("yield");
#endif
  }

  bool is_forked() const { return getpid() != process_; }

  void work(const std::function<void(int, int)>& task, int jobs, int worker) {
    FlushDenormals flush;
    for (int index = next_.fetch_add(1); index < jobs; index = next_.fetch_add(1)) {
      try {
        task(index, worker);
      } catch (...) {
        std::lock_guard lock(mutex_);
        if (!error_) error_ = std::current_exception();
        next_.store(jobs);
      }
    }
  }

  void close() {
    {
      std::lock_guard lock(mutex_);
      closing_ = true;
    }
    wake_.notify_all();
    for (std::thread& worker : workers_) worker.join();
    workers_.clear();
  }

  void serve(int worker) {
    long seen = 0;
    std::unique_lock lock(mutex_);
    for (;;) {
      wake_.wait(lock, [&] { return closing_ || generation_ != seen; });
      if (closing_) return;
      seen = generation_;
      if (!task_) continue;
      busy_++;
      const std::function<void(int, int)>* task = task_;
      int jobs = jobs_;
      lock.unlock();
      work(*task, jobs, worker);
      lock.lock();
      if (--busy_ == 0) done_.notify_one();
    }
  }

  const pid_t process_ = getpid();
  int count_ = 1;
  std::vector<std::thread> workers_;
  std::mutex callers_;  // one run() at a time
  std::mutex mutex_;    // guards the members below
  Condition wake_;
  Condition done_;
  const std::function<void(int, int)>* task_ = nullptr;
  int jobs_ = 0;
  std::atomic<int> busy_{0};  // workers that have begun; modified under the lock
  long generation_ = 0;
  bool closing_ = false;
  std::exception_ptr error_;
  std::atomic<int> next_{0};
};

}  // namespace evs
