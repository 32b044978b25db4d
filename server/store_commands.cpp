#include "server/store_commands.h"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <string>

#include "absl/strings/str_cat.h"
#include "server/store/check.h"
#include "server/store/filesystem.h"

namespace tessera::server {
namespace {

absl::Status check(const std::string& folder) {
  const auto findings = check_store(folder, real_filesystem());
  if (!findings.ok()) return findings.status();
  for (const std::string& fault : findings->faults) std::printf("fault: %s\n", fault.c_str());
  for (const std::string& file : findings->litter) {
    std::printf("left over, to be removed by the next start: %s\n", file.c_str());
  }
  std::printf("%s\n",
              absl::StrCat(findings->jobs, " jobs, ", findings->units, " units, ", findings->blocks,
                           " blocks, ", findings->frames, " frames, ", findings->assets,
                           " assets: ", findings->faults.size(), " faults")
                  .c_str());
  if (findings->faults.empty()) return absl::OkStatus();
  return absl::DataLossError(absl::StrCat("store ", folder, " is damaged"));
}

}  // namespace

void add_store_commands(CLI::App& app, std::function<absl::Status()>& run) {
  auto folder = std::make_shared<std::string>();
  CLI::App* command = app.add_subcommand(
      "check", "Compare every row of a store that no server uses with its files; changes nothing");
  command->add_option("store", *folder, "Folder of the store")->required()->type_name("DIR");
  command->callback([folder, &run] { run = [folder] { return check(*folder); }; });
}

}  // namespace tessera::server
