#include <sys/stat.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <system_error>
#include <thread>

#include "absl/strings/str_cat.h"
#include "client/commands/commands.h"
#include "client/api/farm_client.h"
#include "client/local_farm/farm_supervisor.h"
#include "client/local_farm/local_farm.h"

namespace tessera::client {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;
using Clock = std::chrono::steady_clock;

constexpr seconds kUpTime{60}, kDownTime{30};  // a busy machine is slow
constexpr milliseconds kPollPeriod{20};
constexpr std::size_t kLongestFolder = 95;  // a socket's path has room for 107 characters

struct FarmOptions {
  int workers = 1, threads = 0;
  std::string store;
};

/// $XDG_DATA_HOME/tessera/farm, else ~/.local/share/tessera/farm.
std::string default_store() {
  if (const char* folder = std::getenv("XDG_DATA_HOME"); folder != nullptr && *folder == '/') {
    return absl::StrCat(folder, "/tessera/farm");
  }
  const char* home = std::getenv("HOME");
  return absl::StrCat(home == nullptr ? "/tmp" : home, "/.local/share/tessera/farm");
}

/// Makes the folder unless it is there. Errors: FailedPrecondition, it is not this user's alone.
absl::Status make_farm_folder(const std::string& folder) {
  if (folder.size() > kLongestFolder) {
    return absl::FailedPreconditionError(absl::StrCat(
        folder, ": too long for a socket's name; set XDG_RUNTIME_DIR to a shorter one"));
  }
  ::mkdir(folder.c_str(), 0700);
  if (is_private_folder(folder)) return absl::OkStatus();
  return absl::FailedPreconditionError(
      absl::StrCat(folder, ": cannot be made, or others can enter it; it needs mode 0700"));
}

/// How many workers have joined and not gone.
int count_workers(FarmClient& client) {
  const auto workers = client.list_workers();
  if (!workers.ok()) return 0;
  return static_cast<int>(std::count_if(workers->begin(), workers->end(), [](const auto& worker) {
    return worker.state() == v1::Worker::STATE_IDLE || worker.state() == v1::Worker::STATE_BUSY;
  }));
}

/// Waits until all workers have joined. Errors: Unavailable, the farm has died or they do not come.
absl::Status wait_for_workers(LocalFarm& farm, int wanted) {
  if (absl::Status up = farm.wait_until_up(); !up.ok()) return up;
  Connection connection;
  connection.server = farm.address();
  connection.connect_timeout = kUpTime;
  const auto client = FarmClient::connect(connection);
  if (!client.ok()) return client.status();
  for (const auto limit = Clock::now() + kUpTime; count_workers(**client) < wanted;) {
    if (absl::Status health = farm.health(); !health.ok()) return health;
    if (Clock::now() > limit) return absl::UnavailableError("the farm's workers do not come up");
    std::this_thread::sleep_for(kPollPeriod);
  }
  return absl::OkStatus();
}

int run_up(const FarmOptions& options) {
  LocalFarmOptions local;
  local.folder = farm_folder();
  local.store = options.store.empty() ? default_store() : options.store;
  local.worker_count = options.workers;
  const int cores = static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));
  local.threads_per_worker =
      options.threads > 0 ? options.threads : std::max(1, cores / options.workers);
  if (absl::Status made = make_farm_folder(local.folder); !made.ok()) return fail(made);
  if (supervisor_pid(local.folder) != 0) {
    return fail(
        absl::AlreadyExistsError("a farm of yours runs already; `tessera farm down` stops it"));
  }
  auto farm = LocalFarm::start(local);  // forks: before any thread
  if (!farm.ok()) return fail(farm.status());
  if (absl::Status up = wait_for_workers(**farm, options.workers); !up.ok()) return fail(up);
  (*farm)->leave_running();
  std::printf("%s\n", (*farm)->address().c_str());
  std::fprintf(stderr, "%d workers of %d threads; store %s, logs %s\n", options.workers,
               local.threads_per_worker, local.store.c_str(), local.folder.c_str());
  return kExitDone;
}

int run_down() {
  const std::string folder = farm_folder();
  const pid_t keeper = supervisor_pid(folder);
  if (keeper == 0 || !is_private_folder(folder)) {
    return fail(absl::UnavailableError(absl::StrCat("no farm of yours runs in ", folder)));
  }
  ::kill(keeper, SIGTERM);
  for (const auto limit = Clock::now() + kDownTime; supervisor_pid(folder) == keeper;) {
    if (Clock::now() > limit) {
      return fail(absl::UnavailableError(
          absl::StrCat("the farm does not end; its keeper is process ", keeper)));
    }
    std::this_thread::sleep_for(kPollPeriod);
  }
  return kExitDone;
}

}  // namespace

void add_farm_command(CLI::App& app, Invocation& invocation) {
  auto options = std::make_shared<FarmOptions>();
  CLI::App* command = app.add_subcommand("farm", "A farm on this machine that stays");
  command->footer("Examples:\n  tessera farm up --workers 2\n  tessera farm down");
  command->require_subcommand(1);
  CLI::App* up = command->add_subcommand(
      "up", "Start a server and workers for this user; other commands find them by themselves");
  up->add_option("--workers", options->workers, "Worker processes")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  up->add_option("--threads", options->threads, "Threads of each (default: all cores, shared out)")
      ->check(CLI::Range(1, 1024))
      ->type_name("N");
  up->add_option("--store", options->store,
                 "Folder of jobs and results (default: $XDG_DATA_HOME/tessera/farm)")
      ->type_name("DIR");
  up->footer(
      "It goes on when the terminal is closed, and its jobs go on after `tessera farm down` and "
      "up.\n"
      "Example:\n  tessera farm up --workers 2\n  tessera submit scene.glb --wait");
  up->callback([options, &invocation] { invocation.run = [options] { return run_up(*options); }; });
  CLI::App* down = command->add_subcommand(
      "down", "Stop it; what is committed is kept, jobs go on when it is up");
  down->footer("Example:\n  tessera farm down");
  down->callback([&invocation] { invocation.run = run_down; });
}

}  // namespace tessera::client
