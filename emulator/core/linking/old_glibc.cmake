# Link _core so that it loads on systems as old as glibc ${EVS_GLIBC}, whatever this machine has.
#
# The compiler stays the one that was chosen, and so do the code and its speed. Only the linker is zig's
# (ziglang, a wheel on PyPI), which knows the symbols of every glibc and binds each to its oldest version.
# libstdc++ goes into the module, because an old system has an old one; it is not visible from outside.
# libgcc.a comes before what zig has in its place, whose __builtin_cpu_supports finds no instruction set.
if(NOT EVS_ZIG)
  set(EVS_ZIG ${Python_EXECUTABLE} -m ziglang)
endif()
foreach(library IN ITEMS libstdc++.a libgcc.a libgcc_s.so.1)
  execute_process(
    COMMAND ${CMAKE_CXX_COMPILER} -print-file-name=${library}
    OUTPUT_VARIABLE found OUTPUT_STRIP_TRAILING_WHITESPACE COMMAND_ERROR_IS_FATAL ANY)
  if(NOT EXISTS ${found})
    message(FATAL_ERROR "EVS_GLIBC: ${CMAKE_CXX_COMPILER} has no ${library}; use g++")
  endif()
  list(APPEND runtime ${found})
endforeach()
target_sources(_core PRIVATE linking/old_glibc.cpp)
list(JOIN EVS_ZIG " " zig)
list(JOIN runtime " " runtime)
set(CMAKE_CXX_CREATE_SHARED_MODULE
  "${zig} c++ -target ${CMAKE_SYSTEM_PROCESSOR}-linux-gnu.${EVS_GLIBC} -nostdlib++ <LINK_FLAGS> -o <TARGET> <OBJECTS> <LINK_LIBRARIES> ${runtime}")
