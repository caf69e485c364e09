// Only in a module that is linked for an old glibc (EVS_GLIBC in CMakeLists.txt): what the headers
// of a newer libstdc++ read of a newer glibc.
#if __has_include(<sys/single_threaded.h>)
#include <sys/single_threaded.h>

// Whether the program has one thread only, which lets libstdc++ count references without atomic
// operations. glibc has it since 2.32; false is always right.
char __libc_single_threaded = 0;
#endif
