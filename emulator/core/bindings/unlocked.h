// Python's lock, given back and taken again by a thread that the interpreter may stop meanwhile.
//
// Up to 3.13 CPython ends a daemon thread that wants its lock while the interpreter exits with
// pthread_exit, which unwinds the stack like an exception. The frames above these let none pass,
// and the process would abort. Such a thread waits for the end of the process here, as from 3.14
// on.
#pragma once

#include <Python.h>
#include <unistd.h>

namespace evs {

template <class Take>
auto take_or_wait(Take take) noexcept {
  try {
    return take();
  } catch (...) {
    // to leave this block would abort, too
    for (;;) pause();
  }
}

// Others run while this lives.
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

// Python may be used while this lives, within an Unlocked.
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
