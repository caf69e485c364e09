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
class Unlocked {
 public:
  Unlocked() noexcept : state_(PyEval_SaveThread()) {}
  ~Unlocked() {
    take_or_wait([this] { PyEval_RestoreThread(state_); });
  }
  Unlocked(const Unlocked&) = delete;
  Unlocked& operator=(const Unlocked&) = delete;

 private:
  PyThreadState* state_;
};

// Acquires the GIL during its lifetime, within an Unlocked.
class Locked {
 public:
  Locked() noexcept : state_(take_or_wait([] { return PyGILState_Ensure(); })) {}
  ~Locked() { PyGILState_Release(state_); }
  Locked(const Locked&) = delete;
  Locked& operator=(const Locked&) = delete;

 private:
  PyGILState_STATE state_;
};

}  // namespace evs
