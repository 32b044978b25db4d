#include "client/request/scene_report.h"

#include <fcntl.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <nlohmann/json.hpp>
#include <utility>

#include "absl/strings/escaping.h"
#include "absl/strings/str_cat.h"
#include "client/cli/command.h"
#include "client/local_farm/local_farm.h"
#include "rpc/settings_message.h"

namespace tessera::client {
namespace {

struct ChildResult {
  std::string output;
  int status = 0;  // of waitpid
};

/// Runs a command and collects its stdout. Errors: Internal.
absl::StatusOr<ChildResult> run_child(const std::vector<std::string>& command) {
  std::array<int, 2> ends{};
  if (::pipe2(ends.data(), O_CLOEXEC) != 0) {
    return absl::InternalError(absl::StrCat("pipe: ", std::strerror(errno)));
  }
  std::vector<char*> argv;
  argv.reserve(command.size() + 1);
  for (const std::string& word : command) argv.push_back(const_cast<char*>(word.c_str()));
  argv.push_back(nullptr);
  posix_spawn_file_actions_t actions;
  posix_spawn_file_actions_init(&actions);
  posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_adddup2(&actions, ends[1], STDOUT_FILENO);
  posix_spawnattr_t attributes;
  posix_spawnattr_init(&attributes);
  sigset_t none;
  sigemptyset(&none);
  posix_spawnattr_setsigmask(&attributes, &none);
  posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGMASK);
  pid_t pid = -1;
  const int error = posix_spawn(&pid, argv[0], &actions, &attributes, argv.data(), environ);
  posix_spawn_file_actions_destroy(&actions);
  posix_spawnattr_destroy(&attributes);
  ::close(ends[1]);
  ChildResult result;
  std::array<char, 65536> buffer;
  ssize_t count = 0;
  while (error == 0 && ((count = ::read(ends[0], buffer.data(), buffer.size())) > 0 ||
                        (count < 0 && errno == EINTR))) {
    if (count > 0) result.output.append(buffer.data(), static_cast<std::size_t>(count));
  }
  ::close(ends[0]);
  if (error != 0) {
    return absl::InternalError(absl::StrCat(command[0], ": ", std::strerror(error)));
  }
  while (::waitpid(pid, &result.status, 0) < 0 && errno == EINTR) {
  }
  return result;
}

absl::StatusOr<SceneReport> parse_report(const std::string& text) {
  SceneReport result;
  result.json = text;
  const auto report = nlohmann::json::parse(text, nullptr, false);
  if (!report.is_object() || !report.contains("resources") || !report.contains("problems")) {
    return absl::InternalError("tessera-worker inspect printed no valid report");
  }
  result.scene_uri = report.value("scene", "");
  for (const auto& entry : report["resources"]) {
    result.resources.push_back({entry.value("uri", ""), entry.value("file", "")});
  }
  for (const auto& entry : report["problems"]) {
    result.problems.push_back({entry.value("severity", "error"), entry.value("file", ""),
                               entry.value("element", ""), entry.value("message", "")});
  }
  return result;
}

}  // namespace

bool SceneReport::has_errors() const {
  return std::any_of(problems.begin(), problems.end(),
                     [](const Problem& problem) { return problem.severity == "error"; });
}

absl::StatusOr<SceneReport> inspect_scene(const std::string& scene, const std::string& environment,
                                          const contract::RenderSettings* settings,
                                          const std::vector<std::string>& further) {
  auto worker = sibling_program("tessera-worker");
  if (!worker.ok()) return worker.status();
  std::vector<std::string> command = {*worker, "inspect", "--json"};
  if (!environment.empty()) command.insert(command.end(), {"--environment", environment});
  if (settings != nullptr) {
    const std::string bytes = contract::to_message(*settings).SerializeAsString();
    command.insert(command.end(), {"--settings", absl::BytesToHexString(bytes)});
  }
  command.insert(command.end(), further.begin(), further.end());
  command.insert(command.end(), {"--", scene});
  const auto result = run_child(command);
  if (!result.ok()) return result.status();
  if (WIFSIGNALED(result->status)) {
    const int signal = WTERMSIG(result->status);
    if (signal == SIGINT || signal == SIGTERM) return absl::CancelledError("interrupted");
    return absl::InvalidArgumentError(
        absl::StrCat(scene, ": the scene loader crashed on this file (", strsignal(signal), ")"));
  }
  if (result->output.empty() && WEXITSTATUS(result->status) == kExitBadInput) {
    return absl::InvalidArgumentError("tessera-worker inspect rejected its arguments (see above)");
  }
  return parse_report(result->output);
}

}  // namespace tessera::client
