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
#include "cli/command.h"
#include "client/api/farm_client.h"
#include "client/commands/farm/farm_commands.h"
#include "client/local_farm/farm_supervisor.h"
#include "client/local_farm/local_farm.h"

namespace tessera::client {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;
using Clock = std::chrono::steady_clock;

constexpr seconds kStartTimeout{60}, kStopTimeout{30};  // generous, for busy machines
constexpr milliseconds kPollPeriod{20};
constexpr std::size_t kMaxFolderLength = 95;  // a socket path has at most 107 characters

struct FarmOptions {
  int workers = 1, threads = 0;
  std::string store;
};

/// Returns $XDG_DATA_HOME/tessera/farm, else ~/.local/share/tessera/farm.
std::string default_store() {
  if (const char* folder = std::getenv("XDG_DATA_HOME"); folder != nullptr && *folder == '/') {
    return absl::StrCat(folder, "/tessera/farm");
  }
  const char* home = std::getenv("HOME");
  return absl::StrCat(home == nullptr ? "/tmp" : home, "/.local/share/tessera/farm");
}

/// Creates the directory if missing. Errors: FailedPrecondition, it is not private to this user.
absl::Status make_farm_folder(const std::string& folder) {
  if (folder.size() > kMaxFolderLength) {
    return absl::FailedPreconditionError(absl::StrCat(
        folder, ": too long for a socket path; set XDG_RUNTIME_DIR to a shorter directory"));
  }
  ::mkdir(folder.c_str(), 0700);
  if (is_private_folder(folder)) return absl::OkStatus();
  return absl::FailedPreconditionError(
      absl::StrCat(folder, ": cannot be created, or other users have access; it needs mode 0700"));
}

/// Returns the number of connected workers.
int count_workers(FarmClient& client) {
  const auto workers = client.list_workers();
  if (!workers.ok()) return 0;
  return static_cast<int>(std::count_if(workers->begin(), workers->end(), [](const auto& worker) {
    return worker.state() == v1::Worker::STATE_IDLE || worker.state() == v1::Worker::STATE_BUSY;
  }));
}

/// Waits until all workers are connected. Errors: Unavailable, the farm died or they do not connect
/// in time.
absl::Status wait_for_workers(LocalFarm& farm, int wanted) {
  if (absl::Status up = farm.wait_until_up(); !up.ok()) return up;
  Connection connection;
  connection.server = farm.address();
  connection.connect_timeout = kStartTimeout;
  const auto client = FarmClient::connect(connection);
  if (!client.ok()) return client.status();
  for (const auto limit = Clock::now() + kStartTimeout; count_workers(**client) < wanted;) {
    if (absl::Status health = farm.health(); !health.ok()) return health;
    if (Clock::now() > limit)
      return absl::UnavailableError("timed out waiting for the farm's workers");
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
        absl::AlreadyExistsError("your farm is already running; `tessera farm down` stops it"));
  }
  auto farm = LocalFarm::start(local);  // forks: before any thread
  if (!farm.ok()) return fail(farm.status());
  if (absl::Status up = wait_for_workers(**farm, options.workers); !up.ok()) return fail(up);
  (*farm)->leave_running();
  std::printf("%s\n", (*farm)->address().c_str());
  std::fprintf(stderr, "workers: %d, threads per worker: %d; store %s; logs %s\n", options.workers,
               local.threads_per_worker, local.store.c_str(), local.folder.c_str());
  return kExitDone;
}

int run_down() {
  const std::string folder = farm_folder();
  const pid_t supervisor = supervisor_pid(folder);
  if (supervisor == 0 || !is_private_folder(folder)) {
    return fail(absl::UnavailableError(absl::StrCat("no farm is running in ", folder)));
  }
  ::kill(supervisor, SIGTERM);
  for (const auto limit = Clock::now() + kStopTimeout; supervisor_pid(folder) == supervisor;) {
    if (Clock::now() > limit) {
      return fail(
          absl::UnavailableError(absl::StrCat("the farm did not stop within ", kStopTimeout.count(),
                                              " s (supervisor process ", supervisor, ")")));
    }
    std::this_thread::sleep_for(kPollPeriod);
  }
  return kExitDone;
}

}  // namespace

void add_farm_command(CLI::App& app, Invocation& invocation) {
  auto options = std::make_shared<FarmOptions>();
  CLI::App* command = cli::add_command(app, "farm", "Manage a persistent farm on this machine");
  command->footer("Examples:\n  tessera farm up --workers 2\n  tessera farm down");
  command->require_subcommand(1);
  CLI::App* up = cli::add_command(
      *command, "up",
      "Start a server and workers for this user; other commands use them by default");
  up->add_option("--workers", options->workers, "Number of worker processes")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  up->add_option("--threads", options->threads,
                 "Threads per worker (default: cores divided by workers)")
      ->check(CLI::Range(1, 1024))
      ->type_name("N");
  up->add_option("--store", options->store,
                 "Directory for jobs and results (default: $XDG_DATA_HOME/tessera/farm)")
      ->type_name("DIR");
  up->footer(
      "The farm keeps running when the terminal is closed. Its jobs resume after `tessera farm "
      "down` and `tessera farm up`.\n"
      "Example:\n  tessera farm up --workers 2\n  tessera submit scene.glb --wait");
  up->callback([options, &invocation] { invocation.run = [options] { return run_up(*options); }; });
  CLI::App* down = cli::add_command(
      *command, "down",
      "Stop the farm; committed results are kept and jobs resume at the next start");
  down->footer("Example:\n  tessera farm down");
  down->callback([&invocation] { invocation.run = run_down; });
}

}  // namespace tessera::client
