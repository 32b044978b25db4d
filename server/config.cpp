#include "server/config.h"

#include <google/protobuf/stubs/common.h>
#include <grpcpp/grpcpp.h>
#include <openssl/crypto.h>
#include <sqlite3.h>
#include <zstd.h>

#include <CLI/CLI.hpp>
#include <memory>
#include <string>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "cli/config_file.h"
#include "cli/exit_codes.h"
#include "cli/finite_range.h"
#include "cli/help_text.h"
#include "cli/version_text.h"
#include "image/codecs/library_versions.h"
#include "server/identity_commands.h"
#include "server/schedule/queue/fair_share.h"
#include "server/store_commands.h"
#include "telemetry/log/log.h"

namespace tessera::server {

std::int64_t to_bytes(double gigabytes) {
  return static_cast<std::int64_t>(gigabytes * 1e9);
}

namespace {

std::string version_text() {
  return cli::version_text(
      "tessera-server", TESSERA_VERSION, cli::kBaselineIsa,
      {{"gRPC", grpc::Version()},
       {"protobuf", google::protobuf::internal::VersionString(GOOGLE_PROTOBUF_VERSION)},
       {"SQLite", sqlite3_libversion()},
       {"OpenSSL", OpenSSL_version(OPENSSL_VERSION_STRING)},
       {"zstd", ZSTD_versionString()}},
      image::library_versions());
}

void add_client_limits(CLI::App& app, Config& config) {
  add_quota_options(app, config.quotas);
  app.add_option("--client-priority", config.client_priority,
                 "With --certs: maximum priority of clients' jobs; admins may use any")
      ->check(CLI::Range(-100, 100))
      ->capture_default_str();
  app.add_option("--client-share", config.client_shares,
                 "Weight of a client in fair share, 0.001 to 1000 (default: 1); repeatable")
      ->type_name("NAME=WEIGHT")
      ->allow_extra_args(false)
      ->check([](const std::string& share) {
        return std::string(parse_shares({share}).status().message());
      });
}

void add_options(CLI::App& app, Config& config) {
  app.add_option(
         "--listen", config.listen,
         "Address to listen on: unix:PATH or HOST:PORT (port 0: any free port); addresses that "
         "other machines can reach require --certs")
      ->type_name("ADDRESS");
  app.add_option("--store", config.store,
                 "Directory for jobs, blocks and images; created if missing")
      ->type_name("DIR");
  app.add_option(
         "--certs", config.certs,
         "Directory with ca.crt, tls.crt and tls.key (see init-certs); TCP then accepts only "
         "callers with a certificate of that authority")
      ->type_name("DIR");
  const auto size = cli::finite_range(0.001, 1e6);
  app.add_option("--film-memory-gb", config.film_memory_gb, "Memory for merged tiles, GB")
      ->check(size)
      ->capture_default_str();
  app.add_option("--ingest-memory-gb", config.ingest_memory_gb,
                 "Memory for delivered blocks until they are durable, GB")
      ->check(size)
      ->capture_default_str();
  app.add_option("--quota-gb", config.quota_gb, "Store size above which new jobs are refused, GB")
      ->check(size)
      ->capture_default_str();
  app.add_option("--asset-quota-gb", config.asset_quota_gb,
                 "Size of scene files above which unused ones are deleted, GB")
      ->check(size)
      ->capture_default_str();
  app.add_option("--job-retention-days", config.job_retention_days,
                 "Days of the server's running time for which ended jobs are kept; 0: for ever")
      ->check(cli::finite_range(0.0, 36'500.0))
      ->capture_default_str();
  app.add_option("--audit-fraction", config.audit_fraction,
                 "Fraction of units re-rendered by a second worker to verify results; 0: none")
      ->check(cli::finite_range(0.0, 1.0))
      ->capture_default_str();
  add_client_limits(app, config);
  app.add_option(
         "--metrics", config.metrics,
         "Prometheus endpoint http://HOST:PORT/metrics, loopback only (port 0: any free port, "
         "see the log)")
      ->type_name("HOST:PORT");
  app.add_option("--log-level", config.log_level, "Minimum level logged to stderr")
      ->check(CLI::IsMember(log_level_names()))
      ->capture_default_str();
}

}  // namespace

absl::StatusOr<std::map<std::string, double>> parse_shares(const std::vector<std::string>& shares) {
  std::map<std::string, double> weights;
  for (const std::string& share : shares) {
    const std::size_t equals = share.rfind('=');
    double weight = 0;
    if (equals == std::string::npos || equals == 0 ||
        !absl::SimpleAtod(share.substr(equals + 1), &weight) || !(weight >= kMinWeight) ||
        !(weight <= kMaxWeight)) {
      return absl::InvalidArgumentError(absl::StrCat(
          "client-share: \"", share, "\" is not NAME=WEIGHT with a weight of 0.001 to 1000"));
    }
    weights[share.substr(0, equals)] = weight;
  }
  return weights;
}

ParsedConfig parse_config(int argc, char** argv) {
  ParsedConfig parsed;
  Config config;
  CLI::App app{"The server of a Tessera farm: accepts jobs, leases units, merges film blocks."};
  app.name("tessera-server");
  app.formatter(cli::help_formatter());
  app.set_version_flag("--version", version_text());
  app.set_help_all_flag("--help-all", "Print the help of all commands");
  app.set_config("--config", "", "TOML file with options; the command line takes precedence");
  app.config_formatter(std::make_shared<cli::ConfigFile>(app));
  add_options(app, config);
  add_identity_commands(app, parsed.command);
  add_store_commands(app, parsed.command);
  app.require_subcommand(0, 1);
  app.footer(
      "Examples:\n  tessera-server --listen 127.0.0.1:7420 --store /var/lib/tessera\n"
      "  tessera-server init-certs certs --host farm.example\n"
      "  tessera-server --listen 0.0.0.0:7420 --store /var/lib/tessera --certs certs\n"
      "The server prints its address on stdout. Loopback TCP without certificates requires the\n"
      "token in STORE/token; a Unix socket requires a directory of mode 0700. SIGTERM stops the "
      "server.");
  try {
    app.parse(argc, argv);
    if (!parsed.command && config.listen.empty()) throw CLI::RequiredError("--listen");
    if (!parsed.command && config.store.empty()) throw CLI::RequiredError("--store");
    if (!config.certs.empty()) complete_quotas(app, config.quota_gb, config.quotas.defaults);
    const absl::Status quotas = parse_quotas(config.quotas).status();
    if (!quotas.ok()) throw CLI::ValidationError(std::string(quotas.message()));
  } catch (const CLI::ParseError& error) {
    parsed.exit_code = app.exit(error) == 0 ? 0 : cli::kExitBadInput;
    parsed.command = nullptr;
    return parsed;
  }
  if (!parsed.command) parsed.config = config;
  return parsed;
}

}  // namespace tessera::server
