#include "client/local_farm/farm_supervisor.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/prctl.h>
#include <sys/signalfd.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <filesystem>
#include <system_error>
#include <thread>

#include "client/local_farm/private_folder.h"

namespace tessera::client {
namespace {

using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr milliseconds kWorkerStopTime{1'000}, kServerStopTime{5'000};
constexpr seconds kShortLife{5};   // a child that ends sooner counts as failing
constexpr int kMaxShortLives = 8;  // consecutive
constexpr char kLockName[] = "/farm.lock", kSocketName[] = "/server.sock";

struct Child {
  pid_t pid = -1;
  std::vector<std::string> command;  // program and arguments
  std::string log;
  Clock::time_point started{};
  Clock::time_point start_at{};  // earliest time of the restart
  int short_lives = 0;
  bool given_up = false;
};

/// Runs the command of `child` in a forked process, which dies with the supervisor and logs to a
/// file.
[[noreturn]] void run_child(const Child& child, pid_t supervisor) {
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);
  if (::getppid() != supervisor) ::_exit(127);  // the supervisor died before the call above
  sigset_t none;
  sigemptyset(&none);
  ::sigprocmask(SIG_SETMASK, &none, nullptr);
  const int log = ::open(child.log.c_str(), O_WRONLY | O_CREAT | O_APPEND, 0600);
  if (log >= 0) ::dup2(log, STDERR_FILENO);
  std::vector<char*> argv;
  for (const std::string& word : child.command) argv.push_back(const_cast<char*>(word.c_str()));
  argv.push_back(nullptr);
  ::execv(argv[0], argv.data());
  ::_exit(127);
}

/// Returns an fcntl lock of a whole file. It ends with its process and is not inherited.
struct flock whole_file() {
  struct flock range {};
  range.l_type = F_WRLCK;
  range.l_whence = SEEK_SET;
  return range;
}

/// Locks a directory until this process ends. Returns false if another process holds the lock.
bool lock_folder(const std::string& folder) {
  const int file = ::open((folder + kLockName).c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0600);
  struct flock range = whole_file();
  return file >= 0 && ::fcntl(file, F_SETLK, &range) == 0;
}

class Supervisor {
 public:
  Supervisor(const SupervisorPlan& plan, int socket)
      : socket_(socket),
        has_temporary_store_(plan.store.empty()),
        is_persistent_(!plan.folder.empty()) {
    folder_ = is_persistent_ ? plan.folder : make_private_folder();
    if (folder_.empty()) {
      send_message("cannot create a private directory in TMPDIR or /tmp");
      ::_exit(1);
    }
    if (is_persistent_ && !lock_folder(folder_)) {
      send_message("a farm is already running in " + folder_ + "; `tessera farm down` stops it");
      ::_exit(1);
    }
    const std::string address = "unix:" + folder_ + kSocketName;
    const std::string store = has_temporary_store_ ? folder_ + "/store" : plan.store;
    server_.command = {plan.server_program, "--listen", address, "--store", store};
    server_.log = folder_ + "/server.log";
    for (int i = 0; i < plan.worker_count; ++i) {
      const std::string name = "local-" + std::to_string(i + 1);
      // The ID is stable, so that the server reclaims the units of a dead worker immediately, and
      // differs between farms on the same store, so that the report distinguishes them.
      const std::string id = name + "-" + std::to_string(::getpid());
      Child worker;
      worker.command = {plan.worker_program,
                        "--server",
                        address,
                        "--id",
                        id,
                        "--name",
                        name,
                        "--threads",
                        std::to_string(plan.threads_per_worker),
                        "--grace",
                        "0"};
      if (!is_persistent_)
        worker.command.insert(worker.command.end(), {"--cache", folder_ + "/cache"});
      worker.log = folder_ + "/" + name + ".log";
      workers_.push_back(std::move(worker));
    }
  }

  [[noreturn]] void run() {
    sigset_t watched;
    sigemptyset(&watched);
    sigaddset(&watched, SIGCHLD);
    if (is_persistent_) sigaddset(&watched, SIGTERM);
    ::sigprocmask(SIG_SETMASK, &watched, nullptr);
    signals_ = ::signalfd(-1, &watched, SFD_CLOEXEC | SFD_NONBLOCK);
    ::unlink((folder_ + kSocketName).c_str());  // left by a supervisor that was killed
    start(server_);
    for (Child& worker : workers_) start(worker);
    send_message(folder_);
    while (wait() && !is_over()) {
      reap();
      restart();
    }
    stop();
  }

 private:
  void send_message(const std::string& message) {
    (void)!::send(socket_, message.data(), message.size(), MSG_NOSIGNAL);
  }

  void start(Child& child) {
    const pid_t supervisor = ::getpid();
    child.started = Clock::now();
    child.pid = ::fork();  // this process has one thread
    if (child.pid == 0) run_child(child, supervisor);
  }

  /// Waits for an event. Returns false once the client or SIGTERM has ended the farm.
  bool wait() {
    int timeout = -1;
    for (const Child* child : children()) {
      if (child->pid >= 0 || child->given_up) continue;
      const auto left =
          std::chrono::duration_cast<milliseconds>(child->start_at - Clock::now()).count() + 1;
      const int wanted = static_cast<int>(std::max<std::int64_t>(0, left));
      timeout = timeout < 0 ? wanted : std::min(timeout, wanted);
    }
    std::array<pollfd, 2> watched = {pollfd{socket_, POLLIN, 0}, pollfd{signals_, POLLIN, 0}};
    ::poll(watched.data(), watched.size(), timeout);
    bool terminated = false;
    signalfd_siginfo info;
    while (::read(signals_, &info, sizeof info) > 0) terminated |= info.ssi_signo == SIGTERM;
    if (watched[0].revents == 0) return !terminated;  // the client never sends anything
    if (is_persistent_) {
      ::close(socket_);
      socket_ = -1;  // ignored by poll
    }
    return is_persistent_ && !terminated;
  }

  void reap() {
    int status = 0;
    for (pid_t pid = ::waitpid(-1, &status, WNOHANG); pid > 0;
         pid = ::waitpid(-1, &status, WNOHANG)) {
      for (Child* child : children()) {
        if (pid == child->pid) on_exit(*child, status);
      }
    }
  }

  /// Schedules the restart of an ended child, immediately if it had run long enough. Does not
  /// restart a child that exited by itself, or a server whose client is connected and reports the
  /// failure.
  void on_exit(Child& child, int status) {
    const Clock::time_point now = Clock::now();
    child.pid = -1;
    child.short_lives = now - child.started < kShortLife ? child.short_lives + 1 : 0;
    child.start_at = now + milliseconds(50) * (1 << child.short_lives);
    // It exits by itself only if it is refused, has no renderer, or cannot use its store.
    child.given_up = WIFEXITED(status) || child.short_lives >= kMaxShortLives ||
                     (!is_persistent_ && &child == &server_);
    if (!child.given_up) return;
    if (&child == &server_) {
      send_message("the server " + end_of(status) + ": " + last_line(server_));
    } else if (no_worker_is_left()) {
      send_message("all workers have failed; the last one " + end_of(status) + ": " +
                   last_line(child));
    }
  }

  bool no_worker_is_left() const {
    return std::all_of(workers_.begin(), workers_.end(),
                       [](const Child& child) { return child.given_up; });
  }

  /// Returns whether a persistent farm has failed; other farms end with their client.
  bool is_over() const { return is_persistent_ && (server_.given_up || no_worker_is_left()); }

  void restart() {
    const Clock::time_point now = Clock::now();
    for (Child* child : children()) {
      if (child->pid < 0 && !child->given_up && now >= child->start_at) start(*child);
    }
  }

  /// Returns all children, the server first.
  std::vector<Child*> children() {
    std::vector<Child*> all = {&server_};
    for (Child& worker : workers_) all.push_back(&worker);
    return all;
  }

  /// Describes a waitpid status: "was killed by signal 9" or "ended with status 1".
  static std::string end_of(int status) {
    return WIFSIGNALED(status) ? "was killed by signal " + std::to_string(WTERMSIG(status))
                               : "ended with status " + std::to_string(WEXITSTATUS(status));
  }

  /// Returns the last line of the child's log, the reason why the program exited.
  static std::string last_line(const Child& child) {
    constexpr off_t kTailBytes = 2'000;
    const int file = ::open(child.log.c_str(), O_RDONLY | O_CLOEXEC);
    if (file < 0) return {};
    const off_t size = ::lseek(file, 0, SEEK_END);
    ::lseek(file, std::max<off_t>(0, size - kTailBytes), SEEK_SET);
    std::array<char, kTailBytes> bytes;
    const ssize_t count = ::read(file, bytes.data(), bytes.size());
    ::close(file);
    std::string text(bytes.data(), static_cast<std::size_t>(std::max<ssize_t>(0, count)));
    while (!text.empty() && text.back() == '\n') text.pop_back();
    const std::size_t line = text.rfind('\n');
    return line == std::string::npos ? text : text.substr(line + 1);
  }

  static void kill_child(const Child& child, int signal) {
    if (child.pid > 0) ::kill(child.pid, signal);
  }

  /// Waits for `child` and kills it after `limit`.
  static void await(Child& child, milliseconds limit) {
    const Clock::time_point deadline = Clock::now() + limit;
    while (child.pid > 0 && ::waitpid(child.pid, nullptr, WNOHANG) == 0) {
      if (Clock::now() >= deadline) {
        ::kill(child.pid, SIGKILL);
        ::waitpid(child.pid, nullptr, 0);
        break;
      }
      std::this_thread::sleep_for(milliseconds(2));
    }
    child.pid = -1;
  }

  /// Waits for renderers of killed agents: they die too and run_child children of this process.
  static void await_orphans() {
    const Clock::time_point deadline = Clock::now() + kWorkerStopTime;
    while (::waitpid(-1, nullptr, WNOHANG) >= 0 && Clock::now() < deadline) {
      std::this_thread::sleep_for(milliseconds(2));
    }
  }

  /// Stops all children and exits. With a persistent store, workers drain; with a temporary one,
  /// all are killed.
  [[noreturn]] void stop() {
    for (const Child& worker : workers_)
      kill_child(worker, has_temporary_store_ ? SIGKILL : SIGTERM);
    if (has_temporary_store_) kill_child(server_, SIGKILL);
    for (Child& worker : workers_) await(worker, kWorkerStopTime);
    kill_child(server_, SIGTERM);
    await(server_, kServerStopTime);
    await_orphans();
    std::error_code ignored;
    if (is_persistent_) {
      std::filesystem::remove(folder_ + kSocketName, ignored);
    } else {
      std::filesystem::remove_all(folder_, ignored);
    }
    ::_exit(0);
  }

  int socket_;  // -1: the client of a persistent farm has closed it
  const bool has_temporary_store_, is_persistent_;
  int signals_ = -1;
  std::string folder_;
  Child server_;
  std::vector<Child> workers_;
};

}  // namespace

void run_supervisor(const SupervisorPlan& plan, int socket) {
  ::setsid();  // the client handles Ctrl-C; this process ends after it
  ::prctl(PR_SET_NAME, "tessera-farm");
  ::prctl(PR_SET_CHILD_SUBREAPER, 1);
  const int null = ::open("/dev/null", O_RDWR);
  for (const int standard : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO}) {
    ::dup2(null, standard);
  }
  // Close all other descriptors: readers of the client's output wait for the last copy.
  constexpr int kSocket = STDERR_FILENO + 1;
  if (socket != kSocket) ::dup3(socket, kSocket, O_CLOEXEC);
  ::close_range(kSocket + 1, ~0u, 0);
  Supervisor(plan, kSocket).run();
}

pid_t supervisor_pid(const std::string& folder) {
  const int file = ::open((folder + kLockName).c_str(), O_RDWR | O_CLOEXEC);
  if (file < 0) return 0;
  struct flock range = whole_file();
  const bool asked = ::fcntl(file, F_GETLK, &range) == 0;
  ::close(file);
  return asked && range.l_type != F_UNLCK ? range.l_pid : 0;
}

}  // namespace tessera::client
