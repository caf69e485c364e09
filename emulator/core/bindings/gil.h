// Release and acquire the GIL in a thread that the interpreter may stop meanwhile.
//
// While the interpreter exits, CPython up to 3.13 ends a daemon thread that acquires the GIL with
// pthread_exit, which unwinds the stack like an exception. The frames of this module are noexcept,
// so the process would abort. Such a thread waits here for the end of the process, as CPython does
// from 3.14 on.
#pragma once

#include <Python.h>
#include <unistd.h>

namespace evs {

template <class Take>
auto take_or_wait(Take take) noexcept {
  try {
    return take();
  } catch (...) {
    // leaving this block would abort, too
    for (;;) pause();
  }
}

// Releases the GIL during its lifetime.
class GilRelease {
 public:
  GilRelease() noexcept : state_(PyEval_SaveThread()) {}
  ~GilRelease() {
    take_or_wait([this] { PyEval_RestoreThread(state_); });
  }
  GilRelease(const GilRelease&) = delete;
  GilRelease& operator=(const GilRelease&) = delete;

 private:
  PyThreadState* state_;
};

// Acquires the GIL during its lifetime, within a GilRelease.
class GilAcquire {
 public:
  GilAcquire() noexcept : state_(take_or_wait([] { return PyGILState_Ensure(); })) {}
  ~GilAcquire() { PyGILState_Release(state_); }
  GilAcquire(const GilAcquire&) = delete;
  GilAcquire& operator=(const GilAcquire&) = delete;

 private:
  PyGILState_STATE state_;
};

}  // namespace evs
