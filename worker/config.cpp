#include "worker/config.h"

#include <draco/core/draco_version.h>
#include <google/protobuf/stubs/common.h>
#include <grpcpp/grpcpp.h>
#include <oneapi/tbb/version.h>
#include <openssl/crypto.h>
#include <zstd.h>

#include <CLI/CLI.hpp>
#include <cstdlib>
#include <fstream>
#include <optional>
#include <string>
#include <string_view>
#include <thread>
#include <tuple>
#include <utility>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "cli/command.h"
#include "cli/command_line.h"
#include "cli/exit_codes.h"
#include "cli/help_text.h"
#include "cli/version_text.h"
#include "contract/structure_names.h"
#include "image/codecs/library_versions.h"
#include "telemetry/log/log.h"
#include "worker/accel/layout/isa.h"
#include "worker/gltf/file/memory_budget.h"

namespace tessera::worker {
namespace {

constexpr std::int64_t kMega = 1'000'000, kGiga = 1'000'000'000;

std::int64_t quarter_of_memory_mb() {
  return static_cast<std::int64_t>(render::machine_memory_bytes()) / 4 / kMega;
}

struct WorkerFlags {
  agent::AgentOptions options;
  std::string token_file, log_level = "info";
  std::int64_t cache_gb = 20, buffer_mb = 256, memory_mb = 0, texture_mb = quarter_of_memory_mb();
  std::int64_t unit_timeout_s = 3600, grace_s = 20;
};

/// Parses two non-negative integers with `separator` between them; nullopt if `text` is not that.
std::optional<std::pair<std::int32_t, std::int32_t>> parse_pair(const std::string& text,
                                                                char separator) {
  std::pair<std::int32_t, std::int32_t> numbers;
  const std::size_t at = text.find(separator);
  if (at == std::string::npos || !absl::SimpleAtoi(text.substr(0, at), &numbers.first) ||
      !absl::SimpleAtoi(text.substr(at + 1), &numbers.second) || numbers.first < 0 ||
      numbers.second < 0) {
    return std::nullopt;
  }
  return numbers;
}

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

/// Adds --isa, restricted to the instruction sets of this processor.
void add_isa(CLI::App& app, render::Isa& isa) {
  app.add_option_function<std::string>(
         "--isa", [&isa](const std::string& name) { isa = *render::parse_isa(name); },
         "Instruction set for ray traversal: avx2 or avx512 (default: the widest supported; pixels "
         "are the same)")
      ->check([](const std::string& name) {
        const auto parsed = render::parse_isa(name);
        if (!parsed) return "unknown instruction set " + name + "; expected avx2 or avx512";
        return render::is_supported(*parsed) ? std::string()
                                             : "this processor does not support " + name;
      });
}

void add_server_options(CLI::App& app, WorkerFlags& flags) {
  agent::AgentOptions& options = flags.options;
  app.add_option("--server", options.server, "Server to work for: unix:PATH or HOST:PORT")
      ->envname("TESSERA_SERVER");
  app.add_option("--certs", options.certs,
                 "Directory with ca.crt, tls.crt and tls.key, for a server on another machine")
      ->envname("TESSERA_CERTS")
      ->type_name("DIR");
  app.add_option("--token", flags.token_file,
                 "File with the server's token; with --certs, a join token (or the token itself in "
                 "TESSERA_TOKEN)")
      ->type_name("FILE");
}

void add_resource_options(CLI::App& app, WorkerFlags& flags) {
  agent::AgentOptions& options = flags.options;
  app.add_option("--threads", options.thread_count,
                 "Number of units rendered at once (default: the number of cores)")
      ->check(CLI::Range(1, 1024));
  app.add_option("--cache", options.cache_folder,
                 "Cache directory for scene files, shared by the workers of a host")
      ->type_name("DIR");
  app.add_option("--cache-gb", flags.cache_gb, "Maximum size of the cache, GB")
      ->capture_default_str()
      ->check(CLI::Range(std::int64_t{0}, std::int64_t{1'000'000}));
  app.add_option("--buffer-mb", flags.buffer_mb, "Memory for unacknowledged results, MB")
      ->capture_default_str()
      ->check(CLI::Range(std::int64_t{1}, std::int64_t{1'000'000}));
  app.add_option("--memory-mb", flags.memory_mb,
                 "Renderer memory limit, MB, excluding file mappings; 0: none")
      ->capture_default_str()
      ->check(CLI::Range(std::int64_t{0}, std::int64_t{100'000'000}));
  app.add_option("--texture-mb", flags.texture_mb,
                 "Texture memory per scene, MB; the rest is mapped from a file in the cache "
                 "directory (default: a quarter of RAM)")
      ->check(CLI::Range(std::int64_t{0}, std::int64_t{100'000'000}));
  add_isa(app, options.isa);
}

void add_worker_options(CLI::App& app, WorkerFlags& flags) {
  add_server_options(app, flags);
  add_resource_options(app, flags);
  agent::AgentOptions& options = flags.options;
  app.add_option(
      "--id", options.worker_id,
      "Persistent worker ID: pool, bans and other decisions about the worker outlast its "
      "restart, and the server reclaims the previous process's units immediately "
      "(default: random, kept in the cache directory for the next worker of the host)");
  app.add_option("--name", options.name, "Display name (default: the host name)");
  app.add_option("--tags", options.tags, "Comma-separated tags, for `submit --require-tag`")
      ->delimiter(',');
  app.add_option("--pool", options.pool,
                 "Pool of the worker unless an operator moves it (default: the pool named default)")
      ->type_name("POOL");
  app.add_option("--unit-timeout", flags.unit_timeout_s,
                 "Maximum seconds per unit; a renderer that takes longer is killed")
      ->capture_default_str()
      ->check(CLI::Range(std::int64_t{1}, std::int64_t{10'000'000}));
  app.add_option("--grace", flags.grace_s, "Seconds allowed after SIGTERM to finish started units")
      ->capture_default_str()
      ->check(CLI::Range(std::int64_t{0}, std::int64_t{1'000'000}));
  app.add_option("--unit-log", options.unit_log,
                 "File to which every state change of a unit is appended")
      ->type_name("FILE");
  app.add_option(
         "--metrics", options.metrics,
         "Prometheus endpoint http://HOST:PORT/metrics, loopback only (port 0: any free port, "
         "see the log)")
      ->type_name("HOST:PORT");
  app.add_option("--log-level", flags.log_level,
                 "Minimum level of lines logged to stderr, and of lines about jobs sent to the "
                 "server (`tessera logs`)")
      ->check(CLI::IsMember(log_level_names()))
      ->capture_default_str();
}

/// Adds the command with which the agent starts its renderer process; not in --help.
CLI::App* add_renderer(CLI::App& app, agent::RendererOptions& options) {
  CLI::App* renderer = cli::add_command(app, "renderer", "")->group("");
  renderer->add_option("--fd", options.fd)->required();
  renderer->add_option("--threads", options.thread_count)->required();
  renderer->add_option("--memory-bytes", options.memory_bytes);
  renderer->add_option("--texel-bytes", options.texel_bytes);
  add_isa(*renderer, options.isa);
  return renderer;
}

void add_inspect_options(CLI::App& inspect, InspectConfig& config) {
  inspect.add_option("scene", config.scene, "glTF file")->required();
  inspect.add_flag("--json", config.json, "Print JSON (tessera.inspect/1)")->required();
  inspect
      .add_option("--environment", config.environment, "Environment map to check with the scene")
      ->type_name("FILE");
  inspect.add_flag("--accelerators", config.accelerators,
                   "Compare all acceleration structures on rays of the scene");
  inspect
      .add_option("--accelerator", config.accelerator,
                  "Acceleration structure to compare with the production BVH")
      ->type_name("NAME")
      ->check(CLI::IsMember(contract::kStructureNames));
  inspect.add_flag("--self-intersections", config.self_intersections,
                   "List intersecting triangles, and report which meshes are closed");
  inspect.add_flag("--validate", config.validate, "List violations of the glTF 2.0 specification");
  inspect.add_flag("--vertex-distances", config.vertex_distances,
                   "Measure distances between vertices, and list those that nearly coincide");
  inspect.add_option("--settings", config.settings_hex)->group("");  // passed by the client
  inspect.footer("Example: tessera-worker inspect scene.glb --json");
}

/// Validates two non-negative integers with `separator` between them.
CLI::Validator is_pair(char separator, const char* form) {
  return {[separator, form](const std::string& text) {
            return parse_pair(text, separator) ? std::string()
                                               : absl::StrCat(text, " is not ", form);
          },
          form};
}

/// Options of debug-pixel as typed.
struct DebugPixelFlags {
  std::string size = "1280x720", pixel;
  std::int64_t seed = 0;
  std::int32_t frame = 0;
};

void add_debug_pixel_options(CLI::App& command, DebugPixelConfig& config, DebugPixelFlags& flags) {
  contract::RenderSettings& settings = config.settings;
  command.add_option("scene", config.scene, "glTF file")->required();
  command.add_option("--size", flags.size, "Frame size, pixels")
      ->check(is_pair('x', "WxH"))
      ->capture_default_str();
  command.add_option("--pixel", flags.pixel, "Pixel in the full frame")
      ->check(is_pair(',', "X,Y"))
      ->required();
  command.add_option("--sample", config.sample, "Index of the sample of the pixel, from 0")
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  command.add_option("--frame", flags.frame, "Frame number")
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  command.add_option("--camera", settings.camera, "Camera (default: the first)")
      ->type_name("NAME|INDEX");
  command.add_option("--seed", flags.seed, "Random seed")
      ->check(CLI::Range(std::int64_t{0}, std::int64_t{4294967295}))
      ->capture_default_str();
  command.add_option("--max-depth", settings.max_depth, "Maximum scattering events per path")
      ->check(CLI::Range(1, 255))
      ->capture_default_str();
  command.add_flag_callback(
      "--guiding", [&settings] { settings.guiding = true; }, "Guide paths by photons");
  command.add_option("--environment", config.environment, "Environment map, latitude-longitude")
      ->type_name("FILE");
  command.footer(
      "Prints the path of one sample: per vertex the hit, normals, BSDF, throughput, radiance with "
      "MIS weights, media and Russian roulette; last the sample's radiance, exactly as it enters "
      "the image.\nExample:\n  tessera-worker debug-pixel scene.glb --size 640x360 --pixel 320,180 "
      "--sample 3");
}

void complete(DebugPixelConfig& config, const DebugPixelFlags& flags) {
  std::tie(config.settings.width, config.settings.height) = *parse_pair(flags.size, 'x');
  std::tie(config.x, config.y) = *parse_pair(flags.pixel, ',');
  config.settings.seed = static_cast<std::uint32_t>(flags.seed);
  config.settings.frames = {{flags.frame, flags.frame, 1}};
}

std::string version_text() {
  return cli::version_text(
      "tessera-worker", TESSERA_VERSION, render::isa_name(render::best_isa()),
      {{"gRPC", grpc::Version()},
       {"protobuf", google::protobuf::internal::VersionString(GOOGLE_PROTOBUF_VERSION)},
       {"OpenSSL", OpenSSL_version(OPENSSL_VERSION_STRING)},
       {"zstd", ZSTD_versionString()},
       {"oneTBB", TBB_runtime_version()},
       {"draco", draco::kDracoVersion}},
      image::library_versions());
}

/// Reads the token and converts units. Returns false, after printing a message, if that fails.
bool complete(WorkerFlags& flags) {
  agent::AgentOptions& options = flags.options;
  if (options.server.empty()) {
    std::fprintf(stderr, "tessera-worker: --server is required\n");
    return false;
  }
  if (!flags.token_file.empty()) {
    std::ifstream file(flags.token_file);
    if (!std::getline(file, options.token)) {
      std::fprintf(stderr, "tessera-worker: %s: cannot read the token\n", flags.token_file.c_str());
      return false;
    }
  } else if (const char* token = std::getenv("TESSERA_TOKEN")) {
    options.token = token;
  }
  options.log = open_log("tessera-worker", flags.log_level);
  options.log_level = log_level(flags.log_level);
  options.cache_bytes = flags.cache_gb * kGiga;
  options.buffer_bytes = flags.buffer_mb * kMega;
  options.memory_bytes = flags.memory_mb * kMega;
  options.texel_bytes = flags.texture_mb * kMega;
  options.unit_timeout = std::chrono::seconds(flags.unit_timeout_s);
  options.grace = std::chrono::seconds(flags.grace_s);
  return true;
}

}  // namespace

std::variant<Config, int> parse_command_line(int argc, char** argv, FaultInjector& faults) {
  CLI::App app("Renders units of work for a Tessera server.", "tessera-worker");
  app.formatter(cli::help_formatter());
  app.set_version_flag("--version", version_text());
  app.set_help_all_flag("--help-all", "Print this help and that of all commands");
  WorkerFlags flags;
  flags.options.thread_count = default_threads();
  flags.options.cache_folder = default_cache();
  add_worker_options(app, flags);
  agent::RendererOptions renderer_options;
  CLI::App* renderer = add_renderer(app, renderer_options);
  faults.add_options(app, *renderer);
  InspectConfig inspect_config;
  CLI::App* inspect = cli::add_command(app, "inspect", "Print the features and faults of a scene");
  add_inspect_options(*inspect, inspect_config);
  DebugPixelConfig debug_config;
  DebugPixelFlags debug_flags;
  CLI::App* debug = cli::add_command(app, "debug-pixel", "Print the path of one sample of a pixel");
  add_debug_pixel_options(*debug, debug_config, debug_flags);
  app.footer("Example: tessera-worker --server unix:/run/tessera/server.sock --threads 8");
  if (const auto ended = cli::parse(app, argc, argv)) return *ended;
  if (renderer->parsed()) {
    renderer_options.before_unit = faults.hooks().before_unit;
    return Config(renderer_options);
  }
  if (inspect->parsed()) return Config(inspect_config);
  if (debug->parsed()) {
    complete(debug_config, debug_flags);
    return Config(std::move(debug_config));
  }
  if (!complete(flags)) return cli::kExitBadInput;
  flags.options.faults = faults.hooks();
  return Config(std::move(flags.options));
}

}  // namespace tessera::worker
