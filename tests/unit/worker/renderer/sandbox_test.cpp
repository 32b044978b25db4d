// enter_sandbox(), in a process that is killed or reports what it could still do.
#include "worker/renderer/sandbox.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <functional>
#include <string>
#include <thread>

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

TEST(Sandbox, NetworkIsBlocked) {
  expect_refused([] { return ::socket(AF_INET, SOCK_STREAM, 0); });
  expect_refused([] { return ::socket(AF_UNIX, SOCK_STREAM, 0); });
}

TEST(Sandbox, ExecAndKillAreBlocked) {
  expect_refused([] { return ::execl("/bin/false", "false", nullptr); });
  expect_refused([] { return ::kill(::getppid(), 0); });
}

TEST(Sandbox, OpeningFilesForWritingIsBlocked) {
  const std::string path = ::testing::TempDir() + "/tessera-sandbox-test";
  expect_refused([&] { return ::open(path.c_str(), O_WRONLY | O_CREAT, 0600); });
  expect_refused([] { return ::open("/dev/null", O_RDWR); });
  expect_refused([] { return ::openat(AT_FDCWD, "/dev/null", O_WRONLY); });
  expect_refused([&] { return ::mkdir(path.c_str(), 0700); });
  expect_refused([&] { return ::unlink(path.c_str()); });
  expect_refused([&] { return ::rename(path.c_str(), "x"); });
}

TEST(Sandbox, RenderingCallsAreAllowed) {
  const auto work = [] {
    int ends[2];
    if (::socketpair(AF_UNIX, SOCK_STREAM, 0, ends) != 0 || !enter_sandbox().ok()) return 1;
    int bytes = 0;
    std::thread([&] { bytes += ::send(ends[0], "abc", 3, 0) == 3 ? 1 : 0; }).join();
    char text[4];
    bytes += static_cast<int>(::recv(ends[1], text, sizeof text, 0));
    const int file = ::open("/proc/self/status", O_RDONLY);
    return bytes == 4 && file >= 0 ? 0 : 1;
  };
  EXPECT_EXIT(::_exit(work()), ::testing::ExitedWithCode(0), "");
}

}  // namespace
}  // namespace tessera::agent
