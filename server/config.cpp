#include "server/config.h"

#include <OpenEXR/OpenEXRConfig.h>
#include <OpenImageIO/oiioversion.h>
#include <google/protobuf/stubs/common.h>
#include <grpcpp/grpcpp.h>
#include <openssl/crypto.h>
#include <sqlite3.h>
#include <zstd.h>

#include <CLI/CLI.hpp>
#include <string>

#include "proto/contract/version_text.h"
#include "proto/log/log.h"

namespace tessera::server {

std::int64_t to_bytes(double gigabytes) {
  return static_cast<std::int64_t>(gigabytes * 1e9);
}

namespace {

std::string version_text() {
  return contract::version_text(
      "tessera-server", TESSERA_VERSION, contract::kBaselineIsa,
      {{"gRPC", grpc::Version()},
       {"protobuf", google::protobuf::internal::VersionString(GOOGLE_PROTOBUF_VERSION)},
       {"SQLite", sqlite3_libversion()},
       {"OpenSSL", OpenSSL_version(OPENSSL_VERSION_STRING)},
       {"zstd", ZSTD_versionString()},
       {"OpenEXR", OPENEXR_VERSION_STRING},
       {"OpenImageIO", OIIO_VERSION_STRING}});
}

}  // namespace

ParsedConfig parse_config(int argc, char** argv) {
  Config config;
  CLI::App app{"The coordinator of a Tessera farm: takes jobs, leases units, merges film blocks."};
  app.name("tessera-server");
  app.set_version_flag("--version", version_text());
  app.set_config("--config", "", "Read options from a TOML file; the command line wins");
  app.add_option("--listen", config.listen,
                 "Where to listen: unix:PATH, or a loopback HOST:PORT (port 0: any free one)")
      ->required()
      ->type_name("ADDRESS");
  app.add_option("--store", config.store, "Folder of jobs, blocks and images; made if needed")
      ->required()
      ->type_name("DIR");
  const auto size = CLI::Range(0.001, 1e6);
  app.add_option("--film-memory", config.film_memory_gb, "Merged tiles kept in memory, GB")
      ->check(size)
      ->capture_default_str();
  app.add_option("--ingest-memory", config.ingest_memory_gb,
                 "Delivered blocks kept in memory until they are durable, GB")
      ->check(size)
      ->capture_default_str();
  app.add_option("--quota-gb", config.quota_gb, "Store size above which jobs are refused, GB")
      ->check(size)
      ->capture_default_str();
  app.add_option("--asset-quota-gb", config.asset_quota_gb,
                 "Size of scene files above which unused ones are deleted, GB")
      ->check(size)
      ->capture_default_str();
  app.add_option("--log-level", config.log_level, "What goes to stderr")
      ->check(CLI::IsMember(log_level_names()))
      ->capture_default_str();
  app.footer(
      "Example:\n  tessera-server --listen 127.0.0.1:7411 --store /var/lib/tessera\n"
      "The address is printed on stdout once it is bound. Loopback TCP needs the token in\n"
      "STORE/token; a Unix socket needs a folder of mode 0700. SIGTERM stops the server.");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return {std::nullopt, app.exit(error) == 0 ? 0 : 2};
  }
  return {config, 0};
}

}  // namespace tessera::server
