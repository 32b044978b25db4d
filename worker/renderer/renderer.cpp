#include "worker/renderer/renderer.h"

#include <sys/prctl.h>
#include <sys/resource.h>

#include <atomic>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "contract/film_block.h"
#include "contract/pass_schedule.h"
#include "contract/version.h"
#include "tessera/v1/renderer.pb.h"
#include "worker/accel/layout/isa.h"
#include "worker/accel/traversal/thread_counts.h"
#include "worker/gltf/file/memory_budget.h"
#include "worker/ipc/message_socket.h"
#include "worker/render/float_control.h"
#include "worker/render/numerics/numerics_check.h"
#include "worker/renderer/loaded_frames.h"
#include "worker/renderer/render_pool.h"
#include "worker/renderer/sandbox.h"

namespace tessera::agent {
namespace {

std::int64_t peak_rss_bytes() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return std::int64_t{usage.ru_maxrss} * 1024;
}

class Renderer {
 public:
  Renderer(const RendererOptions& options, std::uint64_t memory_bytes)
      : options_(options),
        socket_(Descriptor(options.fd)),
        frames_(options.isa, {options.texel_bytes, memory_bytes}),
        pool_(options.thread_count) {}

  int run() {
    announce();
    while (true) {
      auto message = socket_.receive();
      if (!message.ok() || !message->has_value()) break;
      v1::RendererCommand command;
      if (!command.ParseFromString(**message) || !execute(command)) break;
    }
    // The agent has closed the socket: nobody waits for running units.
    std::_Exit(0);
  }

 private:
  void announce() {
    v1::RendererEvent event;
    v1::RendererReady& ready = *event.mutable_ready();
    ready.set_contract_version(contract::kRenderContract);
    ready.set_isa(std::string(render::isa_name(options_.isa)));
    const auto digest = render::numerics_digest(options_.isa);
    if (digest.ok()) {
      ready.set_numerics_sha256(digest->binary());
    } else {
      ready.set_error(std::string(digest.status().message()));
    }
    send(event);
  }

  bool execute(v1::RendererCommand& command) {
    switch (command.command_case()) {
      case v1::RendererCommand::kLoadScene:
        return load(std::move(*command.mutable_load_scene()));
      case v1::RendererCommand::kRenderUnit: {
        auto unit = std::move(*command.mutable_render_unit());
        pool_.submit([this, unit = std::move(unit)] { render_unit(unit); });
        return true;
      }
      case v1::RendererCommand::kUnloadScene:
        frames_.unload(command.unload_scene());
        return true;
      default:
        return false;
    }
  }

  /// Loads scenes one at a time on their own thread, helped by threads without a unit, so that this
  /// thread keeps reading commands.
  bool load(v1::LoadScene command) {
    // The scene's files, and one for texels over the limit.
    auto descriptors =
        socket_.receive_descriptors(static_cast<std::size_t>(command.manifest().assets_size()) + 1);
    if (!descriptors.ok()) return false;
    const auto files = std::make_shared<std::vector<Descriptor>>(*std::move(descriptors));
    loader_.submit([this, command = std::move(command), files] {
      std::atomic<std::int64_t> helper_cpu_ns = 0;
      const auto outcome =
          frames_.load(command, std::move(*files), pool_.parallel_for(helper_cpu_ns));
      v1::RendererEvent event;
      v1::LoadSceneResult& scene = *event.mutable_scene();
      scene.set_job_id(command.job_id());
      scene.set_frame(command.frame());
      scene.set_peak_rss_bytes(peak_rss_bytes());
      if (outcome.ok()) {
        scene.set_load_seconds(outcome->load_seconds);
        scene.set_build_seconds(outcome->build_seconds);
        scene.set_accelerator_build_seconds(outcome->accelerator_build_seconds);
        scene.set_accelerator_bytes(outcome->accelerator_bytes);
      } else {
        scene.set_error(std::string(outcome.status().message()));
        scene.set_error_code(static_cast<std::int32_t>(outcome.status().code()));
      }
      send(event);
    });
    return true;
  }

  void render_unit(const v1::RenderUnit& unit) {
    const std::int64_t start = thread_cpu_ns();
    std::atomic<std::int64_t> helper_cpu_ns = 0;
    v1::RendererEvent event;
    *event.mutable_started() = unit;
    send(event);
    if (options_.before_unit) options_.before_unit({unit.frame(), unit.tile(), unit.pass()});
    v1::RenderUnitResult& result = *event.mutable_unit();
    *result.mutable_unit() = unit;
    const contract::TraversalCounts before = render::thread_traversal_counts();
    auto block = render_block(unit, helper_cpu_ns);
    const contract::TraversalCounts cost = render::thread_traversal_counts() - before;
    result.set_ray_count(cost.rays);
    result.set_visited_node_count(cost.nodes);
    result.set_tested_primitive_count(cost.primitives);
    if (block.ok()) {
      result.set_block(*std::move(block));
    } else {
      result.set_error(std::string(block.status().message()));
    }
    result.set_cpu_seconds(1e-9 * static_cast<double>(thread_cpu_ns() - start + helper_cpu_ns));
    send(event);
  }

  absl::StatusOr<std::string> render_block(const v1::RenderUnit& unit,
                                           std::atomic<std::int64_t>& helper_cpu_ns) {
    const auto frame = frames_.find(unit.job_id(), unit.frame());
    if (frame == nullptr) return absl::FailedPreconditionError("the scene is not loaded");
    if (unit.tile() < 0 || unit.tile() >= frame->grid.tile_count()) {
      return absl::InvalidArgumentError(absl::StrCat("tile ", unit.tile(), " of a frame of ",
                                                     frame->grid.tile_count(), " tiles"));
    }
    if (!render::has_ieee_floats()) {
      return absl::InternalError(render::describe_float_fault());
    }
    return contract::encode(frame->renderer->render(
        frame->grid.rect(unit.tile()), contract::Pass{unit.first_sample(), unit.sample_count()},
        unit.pass(), pool_.parallel_for(helper_cpu_ns)));
  }

  void send(const v1::RendererEvent& event) {
    // If the agent has closed the socket, the main thread notices as well.
    (void)socket_.send(event.SerializeAsString());
  }

  const RendererOptions options_;
  MessageSocket socket_;
  LoadedFrames frames_;
  RenderPool pool_;
  RenderPool loader_{1};
};

}  // namespace

int run_renderer(const RendererOptions& options) {
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);
  ::prctl(PR_SET_NAME, "tessera-render");
  // A terminal, Slurm and systemd signal all processes of a job; the agent handles the signal.
  for (const int signal : {SIGTERM, SIGINT, SIGHUP}) ::signal(signal, SIG_IGN);
  limit_resources(options.memory_bytes);
  const std::uint64_t memory = render::machine_memory_bytes();  // reads files
  if (const auto confined = enter_sandbox(); !confined.ok()) {
    std::fprintf(stderr, "warning: the renderer runs without a seccomp sandbox: %s\n",
                 std::string(confined.status().message()).c_str());
  }
  return Renderer(options, memory).run();
}

}  // namespace tessera::agent
