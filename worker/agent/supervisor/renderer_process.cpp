#include "worker/agent/supervisor/renderer_process.h"

#include <fcntl.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <fstream>
#include <utility>

#include "absl/strings/str_cat.h"

namespace tessera::agent {
namespace {

constexpr std::size_t kLogTailBytes = 8 << 10;
constexpr int kChildSocket = 3;

/// posix_spawn settings of a renderer: descriptors, signals and process group.
class SpawnSettings {
 public:
  SpawnSettings(int socket, int log) {
    posix_spawn_file_actions_init(&actions_);
    posix_spawn_file_actions_addopen(&actions_, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
    posix_spawn_file_actions_addopen(&actions_, STDOUT_FILENO, "/dev/null", O_WRONLY, 0);
    posix_spawn_file_actions_adddup2(&actions_, log, STDERR_FILENO);
    posix_spawn_file_actions_adddup2(&actions_, socket, kChildSocket);
    posix_spawnattr_init(&attributes_);
    sigset_t none, all;
    sigemptyset(&none);
    sigfillset(&all);
    posix_spawnattr_setsigmask(&attributes_, &none);
    posix_spawnattr_setsigdefault(&attributes_, &all);
    posix_spawnattr_setpgroup(&attributes_, 0);  // the agent handles Ctrl-C
    posix_spawnattr_setflags(
        &attributes_, POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF | POSIX_SPAWN_SETPGROUP);
  }
  ~SpawnSettings() {
    posix_spawn_file_actions_destroy(&actions_);
    posix_spawnattr_destroy(&attributes_);
  }
  SpawnSettings(const SpawnSettings&) = delete;
  SpawnSettings& operator=(const SpawnSettings&) = delete;

  int spawn(pid_t& pid, const std::string& program, const std::vector<std::string>& arguments) {
    std::vector<char*> argv = {const_cast<char*>(program.c_str())};
    for (const std::string& argument : arguments) {
      argv.push_back(const_cast<char*>(argument.c_str()));
    }
    argv.push_back(nullptr);
    return posix_spawn(&pid, program.c_str(), &actions_, &attributes_, argv.data(), environ);
  }

 private:
  posix_spawn_file_actions_t actions_;
  posix_spawnattr_t attributes_;
};

/// Both ends of the socket and the log pipe of a child.
struct Channels {
  RendererProcess::Child child;  // the agent's ends
  Descriptor socket, log;        // the child's ends
};

absl::StatusOr<Channels> open_channels() {
  auto sockets = socket_pair();
  if (!sockets.ok()) return sockets.status();
  std::array<int, 2> pipe_ends{};
  if (::pipe2(pipe_ends.data(), O_CLOEXEC) != 0) {
    return absl::InternalError(absl::StrCat("pipe: ", std::strerror(errno)));
  }
  Channels channels;
  channels.child.socket = std::move(sockets->first);
  channels.child.log = Descriptor(pipe_ends[0]);
  channels.socket = std::move(sockets->second);
  channels.log = Descriptor(pipe_ends[1]);
  return channels;
}

std::string describe_end(int status) {
  if (WIFSIGNALED(status)) {
    const int signal = WTERMSIG(status);
    const char* name = sigabbrev_np(signal);
    return absl::StrCat("killed by SIG", name == nullptr ? "?" : name, " (", strsignal(signal),
                        ")");
  }
  return absl::StrCat("exited with status ", WEXITSTATUS(status));
}

}  // namespace

absl::StatusOr<RendererProcess::Child> RendererProcess::start(
    const std::string& program, const std::vector<std::string>& arguments) {
  auto channels = open_channels();
  if (!channels.ok()) return channels.status();
  SpawnSettings settings(channels->socket.get(), channels->log.get());
  if (const int error = settings.spawn(channels->child.pid, program, arguments); error != 0) {
    return absl::InternalError(absl::StrCat(program, ": ", std::strerror(error)));
  }
  return std::move(channels->child);
}

absl::StatusOr<RendererProcess::Child> RendererProcess::fork_off(
    const std::function<int()>& child_main) {
  auto channels = open_channels();
  if (!channels.ok()) return channels.status();
  channels->child.pid = ::fork();
  if (channels->child.pid < 0) {
    return absl::InternalError(absl::StrCat("fork: ", std::strerror(errno)));
  }
  if (channels->child.pid > 0) return std::move(channels->child);
  ::setpgid(0, 0);  // the agent handles Ctrl-C
  const int null = ::open("/dev/null", O_RDWR);
  ::dup2(null, STDIN_FILENO);
  ::dup2(null, STDOUT_FILENO);
  ::dup2(channels->log.get(), STDERR_FILENO);
  if (channels->socket.get() != kChildSocket) ::dup2(channels->socket.get(), kChildSocket);
  ::close_range(kChildSocket + 1, ~0u, 0);
  ::_exit(child_main());
}

RendererProcess::RendererProcess(Child child, Listener listener)
    : pid_(child.pid),
      socket_(std::move(child.socket)),
      log_(std::move(child.log)),
      listener_(std::move(listener)) {
  log_thread_ = std::thread([this] { copy_log(); });
  event_thread_ = std::thread([this] { listen(); });
}

RendererProcess::~RendererProcess() {
  kill();
  event_thread_.join();
}

absl::Status RendererProcess::send(const v1::RendererCommand& command,
                                   std::span<const int> descriptors) {
  return socket_.send(command.SerializeAsString(), descriptors);
}

void RendererProcess::kill() {
  const std::lock_guard lock(mutex_);
  if (!reaped_) ::kill(pid_, SIGKILL);  // once reaped, the pid may be reused
}

void RendererProcess::listen() {
  while (true) {
    auto message = socket_.receive();
    v1::RendererEvent event;
    if (!message.ok() || !message->has_value() || !event.ParseFromString(**message)) break;
    listener_.on_event(std::move(event));
  }
  kill();  // after an invalid message; harmless if the child is dead
  Death death;
  death.reason = wait_for_end();
  log_thread_.join();
  death.log_tail = std::move(log_tail_);
  listener_.on_death(std::move(death));
}

/// Copies the child's stderr to this process's stderr and keeps its tail for reports.
void RendererProcess::copy_log() {
  std::array<char, 4096> buffer;
  while (true) {
    const ssize_t count = ::read(log_.get(), buffer.data(), buffer.size());
    if (count < 0 && errno == EINTR) continue;
    if (count <= 0) return;
    (void)!::write(STDERR_FILENO, buffer.data(), static_cast<std::size_t>(count));
    const std::lock_guard lock(mutex_);
    log_tail_.append(buffer.data(), static_cast<std::size_t>(count));
    if (log_tail_.size() > kLogTailBytes) log_tail_.erase(0, log_tail_.size() - kLogTailBytes);
  }
}

std::string RendererProcess::wait_for_end() {
  siginfo_t info{};
  // Waits without reaping first, so that kill() never sees a reused pid.
  while (::waitid(P_PID, static_cast<id_t>(pid_), &info, WEXITED | WNOWAIT) != 0 &&
         errno == EINTR) {
  }
  const std::lock_guard lock(mutex_);
  int status = 0;
  ::waitpid(pid_, &status, 0);
  reaped_ = true;
  return describe_end(status);
}

std::int64_t resident_bytes(pid_t pid) {
  std::ifstream file(absl::StrCat("/proc/", pid, "/statm"));
  std::int64_t total_pages = 0, resident_pages = 0;
  if (!(file >> total_pages >> resident_pages)) return 0;
  return resident_pages * ::sysconf(_SC_PAGESIZE);
}

}  // namespace tessera::agent
