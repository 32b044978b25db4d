// tessera-worker with faults that tests inject.

#include <CLI/CLI.hpp>
#include <charconv>
#include <chrono>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "absl/strings/str_cat.h"
#include "contract/digest.h"
#include "contract/unit.h"
#include "tessera/v1/worker_service.pb.h"
#include "worker/program.h"

namespace tessera::worker {
namespace {

using Block = agent::UnitQueue::Block;

/// Parses "FRAME:TILE:PASS".
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

/// Returns `block` with one bit changed, under a lease attempt that the server did not grant.
Block forged(Block block) {
  v1::Lease lease = *block.lease;
  lease.set_attempt_counter(lease.attempt_counter() + 1);
  std::string bytes = *block.bytes;
  bytes.front() ^= 1;
  block.sha256 = contract::sha256(bytes);
  block.lease = std::make_shared<const v1::Lease>(std::move(lease));
  block.bytes = std::make_shared<const std::string>(std::move(bytes));
  return block;
}

class TestFaults : public FaultInjector {
 public:
  void add_options(CLI::App& worker, CLI::App& renderer) override {
    const CLI::Validator is_unit(
        [](const std::string& text) {
          return parse_unit(text) ? std::string() : "not FRAME:TILE:PASS: " + text;
        },
        "FRAME:TILE:PASS");
    for (CLI::App* app : {&worker, &renderer}) {
      app->add_option("--fault-crash-on", crash_on_, "Unit on which the renderer crashes (SIGSEGV)")
          ->check(is_unit);
      app->add_option(
             "--fault-pause", pause_ms_,
             "Milliseconds to sleep before each unit, so that little CPU time keeps a worker busy")
          ->check(CLI::Range(0, 10'000));
    }
    worker
        .add_option("--fault-corrupt-every", corrupt_every_,
                    "Interval of corruption: every Nth block has a wrong bit")
        ->check(CLI::PositiveNumber);
    worker.add_flag("--fault-forge", forge_,
                    "Delivery of a corrupt block under an invalid lease before each block");
    worker.add_flag("--fault-deliver-twice", deliver_twice_, "Delivery of every block twice");
  }

  agent::FaultHooks hooks() override {
    agent::FaultHooks hooks;
    const auto crash_unit = parse_unit(crash_on_);
    if (crash_unit || pause_ms_ > 0) {
      hooks.before_unit = [crash_unit, pause = std::chrono::milliseconds(pause_ms_)](
                              const contract::Unit& started) {
        std::this_thread::sleep_for(pause);
        if (started == crash_unit) crash(started);
      };
    }
    if (crash_unit) hooks.renderer_arguments = {"--fault-crash-on", crash_on_};
    if (pause_ms_ > 0) {
      hooks.renderer_arguments.insert(hooks.renderer_arguments.end(),
                                      {"--fault-pause", absl::StrCat(pause_ms_)});
    }
    if (corrupt_every_ > 0) {
      hooks.block_rendered = [this](std::string& block) {
        // The least significant bit of the first pixel's red.
        if (++rendered_count_ % corrupt_every_ == 0) block.front() ^= 1;
      };
    }
    if (forge_ || deliver_twice_) {
      hooks.blocks_to_send = [this](Block block) {
        std::vector<Block> blocks;
        if (forge_) blocks.push_back(forged(block));
        if (deliver_twice_) blocks.push_back(block);
        blocks.push_back(std::move(block));
        return blocks;
      };
    }
    return hooks;
  }

 private:
  static void crash(const contract::Unit& unit) {
    std::fprintf(stderr, "fault injection: crashing on unit %d:%d:%d\n", unit.frame, unit.tile,
                 unit.pass);
    std::signal(SIGSEGV, SIG_DFL);
    std::raise(SIGSEGV);
  }

  std::string crash_on_;
  int pause_ms_ = 0;
  std::int64_t corrupt_every_ = 0, rendered_count_ = 0;
  bool forge_ = false, deliver_twice_ = false;
};

}  // namespace
}  // namespace tessera::worker

int main(int argc, char** argv) {
  tessera::worker::TestFaults faults;
  return tessera::worker::run_program(argc, argv, faults);
}
