# zig as a compiler for Macs with Apple silicon. $EVS_ZIG is a Python that has ziglang.
set(CMAKE_SYSTEM_NAME Darwin)
set(CMAKE_SYSTEM_PROCESSOR arm64)
set(zig ${CMAKE_BINARY_DIR}/zig)
if(DEFINED ENV{EVS_ZIG})
  # zig's linker makes a library where Apple's makes a bundle, which Python loads as well. It cannot read
  # nanobind's list of Python's symbols: any symbol may be missing here, and audit_macho.py reads the list.
  set(words "for word; do
  shift
  case $word in
  -bundle) word=-dynamiclib ;;
  -Wl,@*/darwin-ld-cpython.sym) word=-Wl,-undefined,dynamic_lookup ;;
  esac
  set -- \"$@\" \"$word\"
done
")
  foreach(command IN ITEMS c++ ar ranlib)
    file(WRITE ${zig}/${command} "#!/bin/sh\n${words}exec '$ENV{EVS_ZIG}' -m ziglang ${command} \"$@\"\n")
    file(CHMOD ${zig}/${command} PERMISSIONS OWNER_READ OWNER_WRITE OWNER_EXECUTE)
  endforeach()
endif()
set(CMAKE_CXX_COMPILER ${zig}/c++)
set(CMAKE_CXX_COMPILER_TARGET aarch64-macos)
set(CMAKE_AR ${zig}/ar)
set(CMAKE_RANLIB ${zig}/ranlib)
set(CMAKE_INSTALL_NAME_TOOL /bin/true)
