#include "worker/config.h"

#include <draco/core/draco_version.h>
#include <google/protobuf/stubs/common.h>
#include <grpcpp/grpcpp.h>
#include <oneapi/tbb/version.h>
#include <openssl/crypto.h>
#include <unistd.h>
#include <zstd.h>

#include <CLI/CLI.hpp>
#include <charconv>
#include <cstdlib>
#include <fstream>
#include <string_view>
#include <thread>

#include "contract/structure_names.h"
#include "cli/version_text.h"
#include "image/codecs/library_versions.h"
#include "telemetry/log/log.h"
#include "worker/accel/layout/isa.h"

namespace tessera::worker {
namespace {

constexpr int kWrongUsage = 2;
constexpr std::int64_t kMega = 1'000'000, kGiga = 1'000'000'000;

std::int64_t quarter_of_memory_mb() {
  return ::sysconf(_SC_PHYS_PAGES) * ::sysconf(_SC_PAGESIZE) / 4 / kMega;
}

struct WorkerFlags {
  agent::AgentOptions options;
  std::string token_file, crash_on, log_level = "info";
  std::int64_t cache_gb = 20, buffer_mb = 256, memory_mb = 0, texture_mb = quarter_of_memory_mb();
  std::int64_t unit_timeout_s = 3600, grace_s = 20;
};

std::string default_cache() {
  if (const char* folder = std::getenv("XDG_CACHE_HOME"); folder != nullptr && *folder != 0) {
    return std::string(folder) + "/tessera";
  }
  const char* home = std::getenv("HOME");
  return std::string(home == nullptr ? "/tmp" : home) + "/.cache/tessera";
}

int default_threads() {
  return static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));
}

/// "FRAME:TILE:PASS".
std::optional<contract::Unit> parse_unit(const std::string& text) {
  contract::Unit unit;
  const char* next = text.data();
  const char* const end = text.data() + text.size();
  for (std::int32_t* field : {&unit.frame, &unit.tile, &unit.pass}) {
    if (field != &unit.frame && (next == end || *next++ != ':')) return std::nullopt;
    const auto result = std::from_chars(next, end, *field);
    if (result.ec != std::errc()) return std::nullopt;
    next = result.ptr;
  }
  return next == end ? std::optional(unit) : std::nullopt;
}

const CLI::Validator& is_unit() {
  static const CLI::Validator validator(
      [](const std::string& text) {
        return parse_unit(text) ? std::string() : "not FRAME:TILE:PASS: " + text;
      },
      "FRAME:TILE:PASS");
  return validator;
}

/// --isa, of those this processor has.
void add_isa(CLI::App& app, render::Isa& isa) {
  app.add_option_function<std::string>(
         "--isa", [&isa](const std::string& name) { isa = *render::parse_isa(name); },
         "Instructions rays are traced with: avx2 or avx512 (default: the widest there is; pixels "
         "are the same)")
      ->check([](const std::string& name) {
        const auto isa_named = render::parse_isa(name);
        if (!isa_named) return "not avx2 or avx512: " + name;
        return render::is_supported(*isa_named) ? std::string() : "this processor lacks " + name;
      });
}

CLI::Option* add_accelerator(CLI::App& app, std::string& accelerator, const char* description) {
  return app.add_option("--accelerator", accelerator, description)
      ->check(CLI::IsMember(contract::kStructureNames));
}

/// --accelerator of what renders, for tests of the structures: not in --help.
void add_hidden_accelerator(CLI::App& app, std::string& accelerator) {
  add_accelerator(app, accelerator, "")->group("");
}

void add_worker_options(CLI::App& app, WorkerFlags& flags) {
  agent::AgentOptions& options = flags.options;
  app.add_option("--server", options.server, "Farm to work for: unix:PATH or HOST:PORT")
      ->envname("TESSERA_SERVER");
  app.add_option("--certs", options.certs,
                 "Folder with ca.crt, tls.crt and tls.key, for a farm on other machines")
      ->envname("TESSERA_CERTS")
      ->type_name("DIR");
  app.add_option("--token", flags.token_file,
                 "File with the farm's token; with --certs, a join token (or put the token itself "
                 "into TESSERA_TOKEN)")
      ->type_name("FILE");
  app.add_option("--threads", options.thread_count, "Units rendered at once (default: all cores)")
      ->check(CLI::Range(1, 1024));
  app.add_option("--cache", options.cache_folder,
                 "Folder for scene files, shared by a host's workers")
      ->type_name("DIR");
  app.add_option("--cache-gb", flags.cache_gb, "Size of the cache, GB")
      ->capture_default_str()
      ->check(CLI::Range(std::int64_t{0}, std::int64_t{1'000'000}));
  app.add_option("--buffer-mb", flags.buffer_mb, "Memory for results without a verdict, MB")
      ->capture_default_str()
      ->check(CLI::Range(std::int64_t{1}, std::int64_t{1'000'000}));
  app.add_option("--memory-mb", flags.memory_mb,
                 "Limit of the renderer's memory, without what is mapped from files, MB; 0: none")
      ->capture_default_str()
      ->check(CLI::Range(std::int64_t{0}, std::int64_t{100'000'000}));
  app.add_option("--texture-mb", flags.texture_mb,
                 "Memory for a scene's images, MB; what is over lies in a file beside the cache "
                 "(default: a quarter of the machine's)")
      ->check(CLI::Range(std::int64_t{0}, std::int64_t{100'000'000}));
  add_isa(app, options.isa);
  add_hidden_accelerator(app, options.accelerator);
  app.add_option("--id", options.worker_id,
                 "Identity kept over restarts; the server takes back at once what an earlier "
                 "process of it had (default: random)");
  app.add_option("--name", options.name, "Name for people (default: the host's)");
  app.add_option("--tags", options.tags, "What jobs may --require of a worker")->delimiter(',');
  app.add_option("--unit-timeout", flags.unit_timeout_s,
                 "Seconds after which a unit counts as hung and its renderer is killed")
      ->capture_default_str()
      ->check(CLI::Range(std::int64_t{1}, std::int64_t{10'000'000}));
  app.add_option("--grace", flags.grace_s, "Seconds from SIGTERM to the end, to finish units in")
      ->capture_default_str()
      ->check(CLI::Range(std::int64_t{0}, std::int64_t{1'000'000}));
  app.add_option("--unit-log", options.unit_log, "File that gets a line for each unit's steps")
      ->type_name("FILE");
  app.add_option("--metrics", options.metrics,
                 "Where Prometheus may ask for metrics, http://HOST:PORT/metrics; on this machine "
                 "only (port 0: any free one, said in the log)")
      ->type_name("HOST:PORT");
  app.add_option("--log-level", flags.log_level,
                 "What goes to stderr, and of lines about jobs to the server (tessera logs)")
      ->check(CLI::IsMember(log_level_names()))
      ->capture_default_str();
  // Faults for tests, on purpose not in --help.
  app.add_option("--crash-on", flags.crash_on)->check(is_unit())->group("");
  app.add_flag("--deliver-twice", options.deliver_twice)->group("");
  app.add_flag("--forge", options.forge)->group("");
  app.add_option("--lie-every", options.lie_every)->group("");
}

CLI::App* add_renderer(CLI::App& app, agent::RendererOptions& options, std::string& crash_on) {
  CLI::App* renderer = app.add_subcommand("renderer")->group("");  // the agent starts it
  renderer->add_option("--fd", options.fd)->required();
  renderer->add_option("--threads", options.thread_count)->required();
  renderer->add_option("--memory-bytes", options.memory_bytes);
  renderer->add_option("--texel-bytes", options.texel_bytes);
  add_isa(*renderer, options.isa);
  add_hidden_accelerator(*renderer, options.accelerator);
  renderer->add_option("--crash-on", crash_on)->check(is_unit());
  return renderer;
}

void add_inspect_options(CLI::App& inspect, InspectConfig& config) {
  inspect.add_option("scene", config.scene, "glTF file")->required();
  inspect.add_flag("--json", config.json, "Print a JSON document, schema tessera.inspect/1")
      ->required();
  inspect.add_option("--environment", config.environment, "Sky to check along with it")
      ->type_name("FILE");
  inspect.add_flag("--accelerators", config.accelerators,
                   "Measure acceleration structures on rays of the scene");
  add_accelerator(inspect, config.accelerator, "The same for production and this structure alone");
  inspect.add_flag("--self-intersections", config.self_intersections,
                   "List triangles that overlap, and say which meshes are closed");
  inspect.add_option("--settings", config.settings_hex)
      ->group("");  // what a client's job will have
}

std::string version_text() {
  return contract::version_text(
      "tessera-worker", TESSERA_VERSION, render::isa_name(render::best_isa()),
      {{"gRPC", grpc::Version()},
       {"protobuf", google::protobuf::internal::VersionString(GOOGLE_PROTOBUF_VERSION)},
       {"OpenSSL", OpenSSL_version(OPENSSL_VERSION_STRING)},
       {"zstd", ZSTD_versionString()},
       {"oneTBB", TBB_runtime_version()},
       {"draco", draco::kDracoVersion}},
      image::library_versions());
}

/// Reads the token and turns units into bytes. False, with a message, if that fails.
bool complete(WorkerFlags& flags) {
  agent::AgentOptions& options = flags.options;
  if (options.server.empty()) {
    std::fprintf(stderr, "tessera-worker: --server is required\n");
    return false;
  }
  if (!flags.token_file.empty()) {
    std::ifstream file(flags.token_file);
    if (!std::getline(file, options.token)) {
      std::fprintf(stderr, "tessera-worker: token file %s cannot be read\n",
                   flags.token_file.c_str());
      return false;
    }
  } else if (const char* token = std::getenv("TESSERA_TOKEN")) {
    options.token = token;
  }
  options.log = open_log("tessera-worker", flags.log_level);
  options.log_level = log_level(flags.log_level);
  options.crash_on = parse_unit(flags.crash_on);
  options.cache_bytes = flags.cache_gb * kGiga;
  options.buffer_bytes = flags.buffer_mb * kMega;
  options.memory_bytes = flags.memory_mb * kMega;
  options.texel_bytes = flags.texture_mb * kMega;
  options.unit_timeout = std::chrono::seconds(flags.unit_timeout_s);
  options.grace = std::chrono::seconds(flags.grace_s);
  return true;
}

}  // namespace

std::variant<Config, int> parse_command_line(int argc, char** argv) {
  CLI::App app("Renders units for a tessera farm.", "tessera-worker");
  app.set_version_flag("--version", version_text());
  WorkerFlags flags;
  flags.options.thread_count = default_threads();
  flags.options.cache_folder = default_cache();
  add_worker_options(app, flags);
  agent::RendererOptions renderer_options;
  std::string crash_on;
  const CLI::App* renderer = add_renderer(app, renderer_options, crash_on);
  InspectConfig inspect_config;
  CLI::App* inspect = app.add_subcommand("inspect", "Print what a scene needs and its faults");
  add_inspect_options(*inspect, inspect_config);
  app.footer("Example: tessera-worker --server unix:/run/tessera/server.sock --threads 8");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {  // CLI11 reports wrong usage, and --help, by throwing
    return app.exit(error) == 0 ? 0 : kWrongUsage;
  }
  if (renderer->parsed()) {
    renderer_options.crash_on = parse_unit(crash_on);
    return Config(renderer_options);
  }
  if (inspect->parsed()) return Config(inspect_config);
  if (!complete(flags)) return kWrongUsage;
  return Config(std::move(flags.options));
}

}  // namespace tessera::worker
