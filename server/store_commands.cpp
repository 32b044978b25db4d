#include "server/store_commands.h"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <string>

#include "absl/strings/str_cat.h"
#include "cli/command.h"
#include "server/store/files/filesystem.h"
#include "server/store/maintenance/backup.h"
#include "server/store/maintenance/check.h"

namespace tessera::server {
namespace {

struct StoreFlags {
  std::string folder, copy;
};

void print_totals(const StoreFindings& findings) {
  std::printf("%s\n", absl::StrCat(findings.jobs, " jobs, ", findings.units, " units, ",
                                   findings.blocks, " blocks, ", findings.frames, " frames, ",
                                   findings.assets, " assets: ", findings.faults.size(), " faults")
                          .c_str());
}

absl::Status check(const std::string& folder) {
  const auto findings = check_store(folder, real_filesystem());
  if (!findings.ok()) return findings.status();
  for (const std::string& fault : findings->faults) std::printf("fault: %s\n", fault.c_str());
  for (const std::string& file : findings->orphans) {
    std::printf("orphaned file, removed at the next server start: %s\n", file.c_str());
  }
  print_totals(*findings);
  if (findings->faults.empty()) return absl::OkStatus();
  return absl::DataLossError(absl::StrCat("store ", folder, " is damaged"));
}

absl::Status back_up(const StoreFlags& flags) {
  const auto findings = back_up_store(flags.folder, flags.copy, real_filesystem());
  if (findings.ok()) print_totals(*findings);
  return findings.status();
}

}  // namespace

void add_store_commands(CLI::App& app, std::function<absl::Status()>& run) {
  auto flags = std::make_shared<StoreFlags>();
  CLI::App* checking = cli::add_command(
      app, "check",
      "Verify the store of a stopped server: compare every row with its files (read-only)");
  checking->add_option("store", flags->folder, "Directory of the store")
      ->required()
      ->type_name("DIR");
  checking->callback([flags, &run] { run = [flags] { return check(flags->folder); }; });

  CLI::App* backup = cli::add_command(
      app, "backup", "Copy a store, even while a server uses it, and verify the copy");
  backup->add_option("store", flags->folder, "Directory of the store")
      ->required()
      ->type_name("DIR");
  backup
      ->add_option("copy", flags->copy,
                   "Directory of the copy, which must not exist; a server can be started on it")
      ->required()
      ->type_name("COPY");
  backup->callback([flags, &run] { run = [flags] { return back_up(*flags); }; });
}

}  // namespace tessera::server
