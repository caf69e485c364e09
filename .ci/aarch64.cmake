# Debian's cross compiler for 64-bit ARM.
set(CMAKE_SYSTEM_NAME Linux)
set(CMAKE_SYSTEM_PROCESSOR aarch64)
set(CMAKE_CXX_COMPILER aarch64-linux-gnu-g++)
# Python's headers are those of this machine's Python, which has the same sizes of all types
set(CMAKE_FIND_ROOT_PATH_MODE_PROGRAM NEVER)
