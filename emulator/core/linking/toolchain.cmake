# Who builds the core, and for which machine: refuses at once, with one line and the fix, what is known
# to fail. .ci/prerequisites.sh says the same before anything is downloaded.

if(WIN32 OR CYGWIN)
  message(FATAL_ERROR "evs does not run on Windows: use it inside WSL 2, where the Linux wheel installs")
endif()
if(APPLE AND CMAKE_SYSTEM_PROCESSOR MATCHES "^(x86_64|i386)$" AND NOT CMAKE_OSX_ARCHITECTURES STREQUAL "arm64")
  message(FATAL_ERROR "evs does not run on Intel Macs: use a Mac with Apple silicon, or Linux")
endif()

# older ones lack __builtin_shufflevector
if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU" AND CMAKE_CXX_COMPILER_VERSION VERSION_LESS 12)
  message(FATAL_ERROR "g++ ${CMAKE_CXX_COMPILER_VERSION} is too old for evs, g++ 12 or newer is needed; "
    "on Debian and Ubuntu: apt install g++-12, then set CXX=g++-12")
endif()
