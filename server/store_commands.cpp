#include "server/store_commands.h"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <map>
#include <memory>
#include <string>

#include "absl/strings/str_cat.h"
#include "cli/command.h"
#include "server/store/files/filesystem.h"
#include "server/store/maintenance/backup.h"
#include "server/store/maintenance/check.h"
#include "server/store/maintenance/recover.h"

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

/// Returns the consequence of lost rows for the user, by the name of their table.
std::string consequence_of_loss(const std::string& table) {
  static const auto& consequences = *new std::map<std::string, std::string>{
      {"jobs", "jobs are missing: submit them again"},
      {"units", "results are rendered again, in jobs that have not ended"},
      {"blocks", "results are rendered again"},
      {"segments", "results are rendered again"},
      {"frames", "frames are rendered again"},
      {"images", "frames are rendered again"},
      {"assets", "scene files are missing: submit the scenes again"},
      {"asset_contents", "scene files are missing: submit the scenes again"},
      {"store", "workers connect as new ones; create join tokens again"},
      {"workers", "the statistics of workers are missing"},
      {"joins", "join tokens may be used again"},
      {"bans", "banned workers may return: ban them again"},
      {"settings", "settings of the farm are missing: weights, budgets, pools, workers set aside"},
      {"events", "consumers of events are told that some are missing"},
      {"totals", "the cost of jobs that are done is too low"},
      {"usage", "results are charged in the hour of their submission"},
      {"past_usage", "the accounts of removed jobs are too low"},
  };
  const auto found = consequences.find(table);
  return found == consequences.end() ? "rows are missing" : found->second;
}

absl::Status recover(const std::string& folder) {
  const auto recovery = recover_store(folder, real_filesystem());
  if (!recovery.ok()) return recovery.status();
  for (const Recovery::Table& table : recovery->tables) {
    if (table.gaps == 0) continue;
    std::printf("%s\n", absl::StrCat("lost rows of ", table.name, " (", table.rows,
                                     " kept): ", consequence_of_loss(table.name))
                            .c_str());
  }
  if (recovery->dropped_rows > 0) {
    std::printf(
        "%s\n",
        absl::StrCat("dropped ", recovery->dropped_rows, " rows that belong to lost ones").c_str());
  }
  std::printf("the damaged database is %s\n", recovery->damaged.c_str());
  return absl::OkStatus();
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

  CLI::App* recovery = cli::add_command(
      app, "recover",
      "Replace the damaged database of a stopped server by one with all rows that can be read");
  recovery->add_option("store", flags->folder, "Directory of the store")
      ->required()
      ->type_name("DIR");
  recovery->callback([flags, &run] { run = [flags] { return recover(flags->folder); }; });
}

}  // namespace tessera::server
