// enter_sandbox(), in a process that reports what it could still do.
#include "worker/renderer/sandbox.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <linux/io_uring.h>
#include <linux/landlock.h>
#include <pthread.h>
#include <sched.h>
#include <sys/mman.h>
#include <sys/mount.h>
#include <sys/prctl.h>
#include <sys/ptrace.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <csignal>
#include <cstdint>
#include <fstream>
#include <functional>
#include <string>
#include <thread>

#include "tests/support/scratch_folder.h"

namespace tessera::agent {
namespace {

/// Exit codes of the confined process.
constexpr int kRefused = 0, kAllowed = 1, kNotConfined = 2;

/// Expects `act`, which returns the result of a system call, to be refused in a confined process.
int refused(const std::function<long()>& act) {
  if (!enter_sandbox().ok()) return kNotConfined;
  errno = 0;
  return act() < 0 && errno == EPERM ? kRefused : kAllowed;
}

void expect_refused(const std::function<long()>& act) {
  EXPECT_EXIT(::_exit(refused(act)), ::testing::ExitedWithCode(kRefused), "");
}

TEST(Sandbox, NewSocketsAreRefused) {
  expect_refused([] { return ::socket(AF_INET, SOCK_STREAM, 0); });
  expect_refused([] { return ::socket(AF_UNIX, SOCK_STREAM, 0); });
  expect_refused([] {
    std::array<int, 2> ends{};
    return ::socketpair(AF_UNIX, SOCK_STREAM, 0, ends.data());
  });
}

TEST(Sandbox, InheritedSocketCannotBeConnected) {
  // A descriptor of this kind could come from a future change of the agent.
  const int open_socket = ::socket(AF_INET, SOCK_DGRAM, 0);
  ASSERT_GE(open_socket, 0);
  sockaddr where{};
  where.sa_family = AF_INET;
  expect_refused([&] { return ::connect(open_socket, &where, sizeof where); });
  expect_refused([&] { return ::bind(open_socket, &where, sizeof where); });
  expect_refused([&] { return ::listen(open_socket, 1); });
  expect_refused([&] { return ::accept(open_socket, nullptr, nullptr); });
  ::close(open_socket);
}

TEST(Sandbox, ProgramsAreRefused) {
  expect_refused([] { return ::execl("/bin/false", "false", nullptr); });
  expect_refused([] {
    const int program = ::open("/bin/false", O_RDONLY);
    std::array<char*, 1> none{};
    return ::syscall(SYS_execveat, program, "", none.data(), none.data(), AT_EMPTY_PATH);
  });
}

#if !defined(ABSL_HAVE_ADDRESS_SANITIZER) && !defined(ABSL_HAVE_THREAD_SANITIZER)
TEST(Sandbox, NewProcessesAreRefused) {
  expect_refused([] { return ::syscall(SYS_fork); });
  expect_refused([] { return ::syscall(SYS_vfork); });
  expect_refused([] { return ::syscall(SYS_clone, SIGCHLD, 0, 0, 0, 0); });
  expect_refused([] { return ::syscall(SYS_clone, CLONE_NEWUSER | SIGCHLD, 0, 0, 0, 0); });
  EXPECT_EXIT(::_exit(enter_sandbox().ok() && ::fork() < 0 ? kRefused : kAllowed),
              ::testing::ExitedWithCode(kRefused), "");
}

TEST(Sandbox, TracingIsRefused) {
  expect_refused([] { return ::ptrace(PTRACE_TRACEME, 0, nullptr, nullptr); });
  expect_refused([] { return ::ptrace(PTRACE_ATTACH, ::getppid(), nullptr, nullptr); });
}

TEST(Sandbox, MemoryBeyondTheLimitIsRefused) {
  constexpr std::int64_t kLimit = 256 << 20;
  const auto allocate = [] {
    limit_resources(kLimit);
    if (!enter_sandbox().ok()) return kNotConfined;
    const auto map = [](std::size_t bytes) {
      return ::mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    };
    if (map(kLimit / 2) == MAP_FAILED) return kNotConfined;
    return map(kLimit) == MAP_FAILED && errno == ENOMEM ? kRefused : kAllowed;
  };
  EXPECT_EXIT(::_exit(allocate()), ::testing::ExitedWithCode(kRefused), "");
}

TEST(Sandbox, FilesOfTheUserCannotBeRead) {
  if (::syscall(SYS_landlock_create_ruleset, nullptr, 0, LANDLOCK_CREATE_RULESET_VERSION) < 1)
    GTEST_SKIP() << "this kernel has no Landlock";
  const tessera::ScratchFolder folder;
  const std::string path = folder.path() + "/tls.key";
  std::ofstream(path) << "secret";
  const auto read = [&] {
    const auto confined = enter_sandbox();
    if (!confined.ok()) return kNotConfined;
    if (!confined->reads_are_limited) return kAllowed;
    const bool is_readable = ::open(path.c_str(), O_RDONLY) >= 0;
    const bool is_listed = ::open(folder.path().c_str(), O_RDONLY | O_DIRECTORY) >= 0;
    const bool is_known = ::open("/etc/passwd", O_RDONLY) >= 0;
    const bool is_other = ::open("/proc/1/cmdline", O_RDONLY) >= 0;
    return is_readable || is_listed || is_known || is_other ? kAllowed : kRefused;
  };
  EXPECT_EXIT(::_exit(read()), ::testing::ExitedWithCode(kRefused), "");
}
#endif

TEST(Sandbox, SignalsToOtherProcessesAreRefused) {
  const pid_t parent = ::getpid();  // of the confined process
  siginfo_t info{};
  info.si_code = SI_QUEUE;
  expect_refused([&] { return ::kill(parent, 0); });
  expect_refused([&] { return ::syscall(SYS_tgkill, parent, parent, 0); });
  expect_refused([&] { return ::syscall(SYS_rt_sigqueueinfo, parent, 0, &info); });
  expect_refused([&] { return ::syscall(SYS_rt_tgsigqueueinfo, parent, parent, 0, &info); });
  expect_refused([&] { return ::syscall(SYS_pidfd_open, parent, 0); });
  EXPECT_EXIT(
      {
        if (enter_sandbox().ok()) ::raise(SIGUSR1);
      },
      ::testing::KilledBySignal(SIGUSR1), "");
}

TEST(Sandbox, MemoryOfOtherProcessesIsRefused) {
  const pid_t parent = ::getpid();
  std::array<char, 8> bytes{};
  iovec here{bytes.data(), bytes.size()};
  expect_refused([&] { return ::process_vm_readv(parent, &here, 1, &here, 1, 0); });
  expect_refused([&] { return ::process_vm_writev(parent, &here, 1, &here, 1, 0); });
  expect_refused([] { return ::memfd_create("code", 0); });
}

TEST(Sandbox, OpeningFilesForWritingIsRefused) {
  const std::string path = ::testing::TempDir() + "/tessera-sandbox-test";
  expect_refused([&] { return ::open(path.c_str(), O_WRONLY | O_CREAT, 0600); });
  expect_refused([] { return ::open("/dev/null", O_RDWR); });
  expect_refused([] { return ::open("/tmp", O_RDWR | O_TMPFILE, 0600); });
  expect_refused([] { return ::openat(AT_FDCWD, "/dev/null", O_WRONLY); });
  expect_refused([&] { return ::creat(path.c_str(), 0600); });
  expect_refused([&] {
    const std::array<std::uint64_t, 3> how = {O_WRONLY | O_CREAT, 0600, 0};
    return ::syscall(SYS_openat2, AT_FDCWD, path.c_str(), how.data(), sizeof how);
  });
}

TEST(Sandbox, OpenFileCannotGrowBeyondItsLimit) {
  const int file = ::memfd_create("texels", 0);
  ASSERT_GE(file, 0);
  const auto write = [&] {
    ::signal(SIGXFSZ, SIG_IGN);
    limit_resources(0);
    if (!enter_sandbox().ok()) return kNotConfined;
    if (::pwrite(file, "x", 1, kMaxFileBytes - 1) != 1) return kNotConfined;
    return ::pwrite(file, "x", 1, kMaxFileBytes) < 0 && errno == EFBIG ? kRefused : kAllowed;
  };
  EXPECT_EXIT(::_exit(write()), ::testing::ExitedWithCode(kRefused), "");
  EXPECT_EXIT(
      {
        limit_resources(0);
        if (enter_sandbox().ok()) ::pwrite(file, "x", 1, kMaxFileBytes);
      },
      ::testing::KilledBySignal(SIGXFSZ), "");
  ::close(file);
}

TEST(Sandbox, ChangingNamesIsRefused) {
  const std::string path = ::testing::TempDir() + "/tessera-sandbox-test";
  expect_refused([&] { return ::mkdir(path.c_str(), 0700); });
  expect_refused([&] { return ::unlink(path.c_str()); });
  expect_refused([&] { return ::rename(path.c_str(), "x"); });
  expect_refused([&] { return ::symlink("/", path.c_str()); });
  expect_refused([&] { return ::link("/bin/false", path.c_str()); });
  expect_refused([&] { return ::truncate(path.c_str(), 0); });
  expect_refused([&] { return ::chmod(path.c_str(), 04755); });
  expect_refused([] { return ::chdir("/"); });
}

TEST(Sandbox, ChangingTheSystemIsRefused) {
  expect_refused([] { return ::mount("none", "/mnt", "tmpfs", 0, nullptr); });
  expect_refused([] { return ::umount2("/", MNT_DETACH); });
  expect_refused([] { return ::unshare(CLONE_NEWUSER); });
  expect_refused([] { return ::setns(0, 0); });
  expect_refused([] { return ::chroot("/"); });
  expect_refused([] { return ::syscall(SYS_bpf, 0, 0, 0); });
  expect_refused([] { return ::syscall(SYS_perf_event_open, 0, 0, -1, -1, 0); });
  expect_refused([] { return ::syscall(SYS_userfaultfd, 0); });
  expect_refused([] { return ::syscall(SYS_keyctl, 0, 0, 0, 0, 0); });
}

TEST(Sandbox, UnfilteredRequestsAreRefused) {
  // io_uring carries out requests that no filter sees.
  io_uring_params parameters{};
  expect_refused([&] { return ::syscall(SYS_io_uring_setup, 4, &parameters); });
  expect_refused([] { return ::syscall(SYS_io_setup, 4, nullptr); });
  // A number that no kernel uses yet.
  expect_refused([] { return ::syscall(2000); });
}

TEST(Sandbox, RaisingLimitsIsRefused) {
  const rlimit limit{0, 0};
  expect_refused([&] { return ::setrlimit(RLIMIT_FSIZE, &limit); });
  expect_refused([&] { return ::setpriority(PRIO_PROCESS, 0, -1); });
}

TEST(Sandbox, PrivilegesCannotBeGained) {
  const auto look = [] {
    if (!enter_sandbox().ok()) return kNotConfined;
    std::ifstream status("/proc/self/status");
    for (std::string line; std::getline(status, line);) {
      if (line.rfind("NoNewPrivs:", 0) == 0) return line.back() == '1' ? kRefused : kAllowed;
    }
    return kAllowed;
  };
  EXPECT_EXIT(::_exit(look()), ::testing::ExitedWithCode(kRefused), "");
}

TEST(Sandbox, RenderingCallsAreAllowed) {
  const auto work = [] {
    std::array<int, 2> ends{};
    if (::socketpair(AF_UNIX, SOCK_STREAM, 0, ends.data()) != 0 || !enter_sandbox().ok()) return 1;
    int bytes = 0;
    std::thread([&] { bytes += ::send(ends[0], "abc", 3, 0) == 3 ? 1 : 0; }).join();
    std::array<char, 4> text{};
    bytes += static_cast<int>(::recv(ends[1], text.data(), text.size(), 0));
    const int file = ::open("/proc/self/status", O_RDONLY);
    const int library = ::open("/usr", O_RDONLY | O_DIRECTORY);
    void* const memory =
        ::mmap(nullptr, 4096, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    return bytes == 4 && file >= 0 && library >= 0 && memory != MAP_FAILED ? 0 : 1;
  };
  EXPECT_EXIT(::_exit(work()), ::testing::ExitedWithCode(0), "");
}

}  // namespace
}  // namespace tessera::agent
