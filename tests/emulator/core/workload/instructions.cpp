// A plug-in of QEMU that prints how many instructions a program has executed (.ci/neon.sh).
//
// It declares what it uses of its header of plug-ins, which not every package of QEMU brings;
// version 1 of this interface is that of QEMU 4.2 to 8.2.

#include <cinttypes>
#include <cstddef>
#include <cstdint>
#include <cstdio>

extern "C" {

struct qemu_plugin_tb;
size_t qemu_plugin_tb_n_insns(const qemu_plugin_tb* block);
void qemu_plugin_register_vcpu_tb_trans_cb(uint64_t id,
                                           void (*translated)(uint64_t, qemu_plugin_tb*));
void qemu_plugin_register_vcpu_tb_exec_inline(qemu_plugin_tb* block, int operation, void* counter,
                                              uint64_t add);
void qemu_plugin_register_atexit_cb(uint64_t id, void (*ended)(uint64_t, void*), void* data);

[[gnu::visibility("default")]] int qemu_plugin_version = 1;

static uint64_t instructions = 0;

static void count_block(uint64_t, qemu_plugin_tb* block) {
  constexpr int ADD = 0;
  qemu_plugin_register_vcpu_tb_exec_inline(block, ADD, &instructions,
                                           qemu_plugin_tb_n_insns(block));
}

static void print(uint64_t, void*) { std::fprintf(stderr, "%" PRIu64 "\n", instructions); }

[[gnu::visibility("default")]] int qemu_plugin_install(uint64_t id, const void*, int, char**) {
  qemu_plugin_register_vcpu_tb_trans_cb(id, count_block);
  qemu_plugin_register_atexit_cb(id, print, nullptr);
  return 0;
}
}
