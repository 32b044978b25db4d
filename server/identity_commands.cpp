#include "server/identity_commands.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/time/time.h"
#include "cli/command.h"
#include "cli/finite_range.h"
#include "server/identity/authority.h"
#include "server/identity/join_tokens.h"
#include "server/identity/private_file.h"
#include "server/store/sqlite/database.h"
#include "server/store/sqlite/schema.h"

namespace tessera::server {
namespace {

using Run = std::function<absl::Status()>;

constexpr double kDay = 86'400;
constexpr int kAuthorityDays = 3650;
constexpr std::int64_t kClockSkew = 3600;  // by which other machines' clocks may be behind

std::int64_t now_s() {
  return std::chrono::duration_cast<std::chrono::seconds>(
             std::chrono::system_clock::now().time_since_epoch())
      .count();
}

/// Begins in the past, for clocks that are behind, but not by more than a tenth of its time.
Validity days_from_now(double days) {
  const auto length = static_cast<std::int64_t>(days * kDay);
  return {now_s() - std::min(kClockSkew, length / 10), now_s() + length};
}

struct CertificateFlags {
  std::string folder, role, name, out;
  std::vector<std::string> hosts;
  double days = 365;
};

void add_folder(CLI::App& command, CertificateFlags& flags) {
  command.add_option("directory", flags.folder, "Directory of the farm's CA")
      ->required()
      ->type_name("DIR");
}

void add_days(CLI::App& command, CertificateFlags& flags) {
  command.add_option("--days", flags.days, "Validity of the certificate, days")
      ->check(cli::finite_range(1e-4, kAuthorityDays))
      ->capture_default_str();
}

void add_who(CLI::App& command, CertificateFlags& flags) {
  command
      .add_option("--role", flags.role,
                  "Role: client (own jobs), worker (leased units) or admin (everything)")
      ->required()
      ->check(CLI::IsMember({"client", "worker", "admin"}));
  command.add_option("--name", flags.name, "Name of the holder; a client's jobs belong to it")
      ->required();
}

absl::Status init_certs(const CertificateFlags& flags) {
  absl::Status status = make_authority(flags.folder, days_from_now(kAuthorityDays));
  if (status.ok()) status = issue_server(flags.folder, flags.hosts, days_from_now(flags.days));
  if (!status.ok()) return status;
  std::fprintf(stderr,
               "%s contains the authority and the server's certificate. ca.key can issue any "
               "certificate; keep it secret.\nNext: tessera-server issue-cert %s --role client "
               "--name NAME\n",
               flags.folder.c_str(), flags.folder.c_str());
  return absl::OkStatus();
}

absl::Status issue_cert(const CertificateFlags& flags) {
  const std::string out =
      flags.out.empty() ? absl::StrCat(flags.folder, "/", flags.role, "-", flags.name) : flags.out;
  absl::Status status = issue(flags.folder, parse_role(flags.role).value_or(Role::client),
                              flags.name, out, days_from_now(flags.days));
  if (status.ok()) std::printf("%s\n", out.c_str());
  return status;
}

absl::Status revoke_cert(const CertificateFlags& flags) {
  return revoke(flags.folder, parse_role(flags.role).value_or(Role::client), flags.name);
}

void add_certificate_commands(CLI::App& app, Run& run) {
  auto flags = std::make_shared<CertificateFlags>();
  CLI::App* init =
      cli::add_command(app, "init-certs",
                       "Create the farm's CA if missing and issue or renew the server certificate");
  add_folder(*init, *flags);
  init->add_option("--host", flags->hosts, "Host names and IP addresses of the server")
      ->required()
      ->type_name("NAME…");
  add_days(*init, *flags);
  init->callback([flags, &run] { run = [flags] { return init_certs(*flags); }; });

  CLI::App* issue = cli::add_command(
      app, "issue-cert", "Issue a certificate into a directory for --certs; prints the directory");
  add_folder(*issue, *flags);
  add_who(*issue, *flags);
  issue->add_option("--out", flags->out, "Directory for the certificate (default: DIR/ROLE-NAME)")
      ->type_name("DIR");
  add_days(*issue, *flags);
  issue->callback([flags, &run] { run = [flags] { return issue_cert(*flags); }; });

  CLI::App* revoke = cli::add_command(
      app, "revoke", "Revoke all certificates issued to a name; takes effect within seconds");
  add_folder(*revoke, *flags);
  add_who(*revoke, *flags);
  revoke->callback([flags, &run] { run = [flags] { return revoke_cert(*flags); }; });
}

struct TokenFlags {
  std::string store, id, out, ttl = "24h";
  std::int64_t max_joins = 0;
};

absl::Status create_token(const TokenFlags& flags) {
  absl::Duration ttl;
  if (!absl::ParseDuration(flags.ttl, &ttl) || ttl < absl::Seconds(1) ||
      ttl > absl::Hours(24 * kAuthorityDays)) {
    return absl::InvalidArgumentError(
        absl::StrCat("--ttl \"", flags.ttl, "\" is not a duration such as 90m, 24h or 720h"));
  }
  const auto token =
      JoinTokens(flags.store).create(now_s() + absl::ToInt64Seconds(ttl), flags.max_joins);
  if (!token.ok()) return token.status();
  if (!flags.out.empty()) return write_file(flags.out, *token + "\n", 0600);
  std::printf("%s\n", token->c_str());
  return absl::OkStatus();
}

/// Returns the number of workers that joined with each token, from the journal.
absl::StatusOr<std::map<std::string, std::int64_t>> count_joins(const std::string& store) {
  auto rows = Database::open(store + "/store.db", "", Database::Mode::reader);
  if (!rows.ok()) return rows.status();
  if (absl::Status status = check_schema(**rows); !status.ok()) return status;
  std::map<std::string, std::int64_t> counts;
  absl::Status status =
      (*rows)->each("SELECT token, COUNT(*) FROM joins GROUP BY token", {},
                    [&](const SqlRow& row) { counts[row.text(0)] = row.integer(1); });
  if (!status.ok()) return status;
  return counts;
}

absl::Status list_tokens(const TokenFlags& flags) {
  const auto tokens = JoinTokens(flags.store).list();
  if (!tokens.ok()) return tokens.status();
  const auto counts = count_joins(flags.store);
  if (!counts.ok()) return counts.status();
  std::printf("%-10s %-22s %s\n", "TOKEN", "EXPIRES", "JOINS");
  for (const JoinToken& token : *tokens) {
    const absl::Time end = absl::FromUnixSeconds(token.expires_s);
    const auto joined = counts->find(token.id);
    const std::int64_t count = joined == counts->end() ? 0 : joined->second;
    std::printf("%-10s %-22s %s\n", token.id.c_str(),
                end <= absl::Now()
                    ? "expired"
                    : absl::FormatTime("%Y-%m-%dT%H:%M:%SZ", end, absl::UTCTimeZone()).c_str(),
                token.max_joins == 0 ? absl::StrCat(count).c_str()
                                     : absl::StrCat(count, " of ", token.max_joins).c_str());
  }
  return absl::OkStatus();
}

void add_token_commands(CLI::App& app, Run& run) {
  auto flags = std::make_shared<TokenFlags>();
  CLI::App* tokens = cli::add_command(
      app, "tokens",
      "Manage the join tokens that workers present, with their certificate, to join");
  tokens->require_subcommand(1);
  const auto add_store = [&](CLI::App& command) {
    command.add_option("--store", flags->store, "Directory of the server's store")
        ->required()
        ->type_name("DIR");
  };
  CLI::App* create =
      cli::add_command(*tokens, "create", "Create a token and print it (shown only once)");
  add_store(*create);
  create->add_option("--ttl", flags->ttl, "Time for which workers can join with the token")
      ->type_name("DURATION")
      ->capture_default_str();
  create
      ->add_option("--max-joins", flags->max_joins,
                   "Maximum number of workers that can join; 0: unlimited")
      ->check(CLI::Range(std::int64_t{0}, std::int64_t{1'000'000}))
      ->capture_default_str();
  create
      ->add_option("--out", flags->out,
                   "File of mode 0600 to write the token to, instead of printing it")
      ->type_name("FILE");
  create->callback([flags, &run] { run = [flags] { return create_token(*flags); }; });

  CLI::App* list = cli::add_command(*tokens, "list", "List tokens without their secrets");
  add_store(*list);
  list->callback([flags, &run] { run = [flags] { return list_tokens(*flags); }; });

  CLI::App* revoke =
      cli::add_command(*tokens, "revoke", "Revoke a token; workers that have joined stay");
  add_store(*revoke);
  revoke->add_option("token", flags->id, "First eight digits of the token")->required();
  revoke->callback(
      [flags, &run] { run = [flags] { return JoinTokens(flags->store).revoke(flags->id); }; });
}

}  // namespace

void add_identity_commands(CLI::App& app, Run& run) {
  add_certificate_commands(app, run);
  add_token_commands(app, run);
}

}  // namespace tessera::server
