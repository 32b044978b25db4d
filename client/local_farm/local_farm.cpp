#include "client/local_farm/local_farm.h"

#include <sys/socket.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstring>
#include <filesystem>
#include <system_error>
#include <utility>

#include "absl/strings/str_cat.h"
#include "client/local_farm/farm_supervisor.h"

namespace tessera::client {
namespace {

using std::chrono::milliseconds;
using Clock = std::chrono::steady_clock;

constexpr milliseconds kStartTimeout{60'000};  // generous, for busy machines

/// Returns the next message of the supervisor; empty when it has ended.
std::string receive(int socket) {
  std::array<char, 4096> text;
  ssize_t count = -1;
  do {
    count = ::recv(socket, text.data(), text.size(), 0);
  } while (count < 0 && errno == EINTR);
  return {text.data(), static_cast<std::size_t>(count < 0 ? 0 : count)};
}

bool can_connect(const std::string& path) {
  sockaddr_un where{};
  where.sun_family = AF_UNIX;
  std::memcpy(where.sun_path, path.c_str(), path.size());  // the supervisor chooses short paths
  const int probe = ::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
  const bool connected =
      ::connect(probe, reinterpret_cast<const sockaddr*>(&where), sizeof where) == 0;
  ::close(probe);
  return connected;
}

}  // namespace

absl::StatusOr<std::string> sibling_program(const std::string& name) {
  std::error_code error;
  const auto self = std::filesystem::read_symlink("/proc/self/exe", error);
  const auto path = self.parent_path() / name;
  if (!error && ::access(path.c_str(), X_OK) == 0) return path.string();
  return absl::NotFoundError(
      absl::StrCat(name, " is not installed beside tessera (", path.parent_path().string(), ")"));
}

absl::StatusOr<std::unique_ptr<LocalFarm>> LocalFarm::start(const LocalFarmOptions& options) {
  SupervisorPlan plan;
  auto server = sibling_program("tessera-server");
  if (!server.ok()) return server.status();
  plan.server_program = *std::move(server);
  auto worker = sibling_program("tessera-worker");
  if (!worker.ok()) return worker.status();
  plan.worker_program = *std::move(worker);
  plan.worker_count = options.worker_count;
  plan.threads_per_worker = options.threads_per_worker;
  plan.folder = options.folder;
  if (!options.store.empty()) {
    std::error_code error;
    plan.store = std::filesystem::absolute(options.store, error).string();
    std::filesystem::create_directories(plan.store, error);
    if (error) {
      return absl::InvalidArgumentError(
          absl::StrCat("--store ", options.store, ": ", error.message()));
    }
  }
  std::array<int, 2> ends{};
  if (::socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, ends.data()) != 0) {
    return absl::InternalError(absl::StrCat("socketpair: ", std::strerror(errno)));
  }
  const pid_t supervisor = ::fork();
  if (supervisor == 0) {
    ::close(ends[0]);
    run_supervisor(plan, ends[1]);
  }
  ::close(ends[1]);
  if (supervisor < 0) {
    ::close(ends[0]);
    return absl::InternalError(absl::StrCat("fork: ", std::strerror(errno)));
  }
  std::string folder = receive(ends[0]);
  if (folder.empty() || folder.front() != '/') {
    ::close(ends[0]);
    ::waitpid(supervisor, nullptr, 0);
    return absl::InternalError(folder.empty() ? "the farm's supervisor process died" : folder);
  }
  return std::unique_ptr<LocalFarm>(
      new LocalFarm(supervisor, ends[0], std::move(folder), !options.folder.empty()));
}

LocalFarm::LocalFarm(pid_t pid, int socket, std::string folder, bool has_own_folder)
    : supervisor_pid_(pid),
      socket_(socket),
      has_own_folder_(has_own_folder),
      folder_(std::move(folder)) {
  // Other threads wait for signals.
  sigset_t all, before;
  sigfillset(&all);
  pthread_sigmask(SIG_SETMASK, &all, &before);
  listener_ = std::thread([this] { listen(); });
  pthread_sigmask(SIG_SETMASK, &before, nullptr);
}

LocalFarm::~LocalFarm() {
  {
    const std::lock_guard lock(mutex_);
    stopping_ = true;
  }
  ::shutdown(socket_, SHUT_RDWR);
  listener_.join();
  ::close(socket_);
  if (outlives_this_) return;
  if (has_own_folder_) ::kill(supervisor_pid_, SIGTERM);
  ::waitpid(supervisor_pid_, nullptr, 0);
  std::error_code ignored;  // done by the supervisor, unless it was killed
  if (!has_own_folder_) std::filesystem::remove_all(folder_, ignored);
}

void LocalFarm::listen() {
  const std::string message = receive(socket_);
  const std::lock_guard lock(mutex_);
  if (stopping_) return;
  health_ = absl::UnavailableError(message.empty() ? "the farm's supervisor process was killed"
                                                   : message);
  if (action_) action_();
}

absl::Status LocalFarm::wait_until_up() {
  const std::string path = folder_ + "/server.sock";
  const Clock::time_point limit = Clock::now() + kStartTimeout;
  while (!can_connect(path)) {
    if (absl::Status status = health(); !status.ok()) return status;
    if (Clock::now() > limit) {
      return absl::UnavailableError("timed out waiting for the farm's server");
    }
    std::this_thread::sleep_for(milliseconds(2));
  }
  return absl::OkStatus();
}

void LocalFarm::on_death(std::function<void()> action) {
  const std::lock_guard lock(mutex_);
  action_ = std::move(action);
  if (!health_.ok() && action_) action_();
}

absl::Status LocalFarm::health() {
  const std::lock_guard lock(mutex_);
  return health_;
}

}  // namespace tessera::client
