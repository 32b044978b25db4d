#include "worker/renderer/sandbox.h"

#include <fcntl.h>
#include <linux/audit.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <vector>

#include "absl/strings/str_cat.h"

// LeakSanitizer stops the process's threads by ptrace, at its end.
#if defined(__SANITIZE_ADDRESS__)
#define TESSERA_LEAK_CHECK 1
#elif defined(__has_feature)
#if __has_feature(address_sanitizer)
#define TESSERA_LEAK_CHECK 1
#endif
#endif

namespace tessera::agent {
namespace {

using Filter = std::vector<sock_filter>;

constexpr std::uint32_t kRefuse = SECCOMP_RET_ERRNO | EPERM;
constexpr std::uint32_t kX32Bit = 0x40000000;  // numbers of the x32 interface, which nobody needs

constexpr std::uint32_t kRefused[] = {
    // The network. (io_uring does by itself what it is asked to, past any filter.)
    SYS_socket,
    SYS_connect,
    SYS_bind,
    SYS_listen,
    SYS_accept,
    SYS_accept4,
    SYS_io_uring_setup,
    SYS_io_uring_enter,
    SYS_io_uring_register,
    // Other programs and processes.
    SYS_execve,
    SYS_execveat,
    SYS_kill,
    SYS_process_vm_readv,
    SYS_process_vm_writev,
    SYS_pidfd_open,
    SYS_pidfd_getfd,
    SYS_pidfd_send_signal,
#ifndef TESSERA_LEAK_CHECK
    SYS_ptrace,
#endif
    // Files and names; openat2 hides its flags from filters.
    SYS_creat,
    SYS_openat2,
    SYS_open_by_handle_at,
    SYS_truncate,
    SYS_unlink,
    SYS_unlinkat,
    SYS_rename,
    SYS_renameat,
    SYS_renameat2,
    SYS_link,
    SYS_linkat,
    SYS_symlink,
    SYS_symlinkat,
    SYS_mkdir,
    SYS_mkdirat,
    SYS_rmdir,
    SYS_mknod,
    SYS_mknodat,
    SYS_chmod,
    SYS_fchmodat,
    SYS_chown,
    SYS_lchown,
    SYS_fchownat,
    SYS_setxattr,
    SYS_lsetxattr,
    SYS_utimensat,
    // The machine.
    SYS_mount,
    SYS_umount2,
    SYS_chroot,
    SYS_pivot_root,
    SYS_unshare,
    SYS_setns,
    SYS_bpf,
    SYS_perf_event_open,
    SYS_userfaultfd,
    SYS_add_key,
    SYS_request_key,
    SYS_keyctl,
};

/// Loads a field of seccomp_data.
void load(Filter& filter, std::size_t offset) {
  filter.push_back(BPF_STMT(BPF_LD | BPF_W | BPF_ABS, static_cast<std::uint32_t>(offset)));
}

void finish(Filter& filter, std::uint32_t verdict) {
  filter.push_back(BPF_STMT(BPF_RET | BPF_K, verdict));
}

/// Refuses `number` with any bit of `bits` in its argument `index` (the low half: little endian).
/// Leaves the number unloaded: comes after all that looks at it, except others of its kind.
void refuse_bits(Filter& filter, std::uint32_t number, std::size_t index, std::uint32_t bits) {
  load(filter, offsetof(seccomp_data, nr));
  filter.push_back(BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, number, 0, 3));
  load(filter, offsetof(seccomp_data, args) + index * sizeof(std::uint64_t));
  filter.push_back(BPF_JUMP(BPF_JMP | BPF_JSET | BPF_K, bits, 0, 1));
  finish(filter, kRefuse);
}

Filter make_filter() {
  Filter filter;
  load(filter, offsetof(seccomp_data, arch));
  filter.push_back(BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, AUDIT_ARCH_X86_64, 1, 0));
  finish(filter, SECCOMP_RET_KILL_PROCESS);
  load(filter, offsetof(seccomp_data, nr));
  filter.push_back(BPF_JUMP(BPF_JMP | BPF_JGE | BPF_K, kX32Bit, 0, 1));
  finish(filter, kRefuse);
  for (const std::uint32_t number : kRefused) {
    filter.push_back(BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, number, 0, 1));
    finish(filter, kRefuse);
  }
  constexpr std::uint32_t kWriting = O_WRONLY | O_RDWR | O_CREAT | O_TRUNC;
  refuse_bits(filter, SYS_open, 1, kWriting);
  refuse_bits(filter, SYS_openat, 2, kWriting);
  finish(filter, SECCOMP_RET_ALLOW);
  return filter;
}

}  // namespace

absl::Status enter_sandbox() {
  Filter filter = make_filter();
  const sock_fprog program{static_cast<unsigned short>(filter.size()), filter.data()};
  // Without privileges a filter is taken only from who can gain none by exec.
  if (::prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0 ||
      ::prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &program) != 0) {
    return absl::UnavailableError(absl::StrCat("seccomp: ", std::strerror(errno)));
  }
  return absl::OkStatus();
}

}  // namespace tessera::agent
