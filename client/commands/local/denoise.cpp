#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <memory>
#include <thread>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "cli/command.h"
#include "client/cli/table.h"
#include "client/commands/local/local_commands.h"
#include "image/denoise/frame_denoiser.h"
#include "image/denoise/layers.h"
#include "image/exr/exr_file.h"

namespace tessera::client {
namespace {

constexpr std::int32_t kBandRows = 64;

struct DenoiseOptions {
  std::string input, output;
  int threads = 0;
  bool force = false;
};

/// m of the frame; 0 if the file does not say.
double mean_luminance(const image::ExrHeader& header) {
  for (const auto& [name, value] : header.reals) {
    if (name == image::kMeanLuminanceAttribute) return value;
  }
  return 0;
}

/// The header of the output: without m, which belongs to the layers that are replaced.
image::ExrHeader output_header(image::ExrHeader header) {
  header.reals.clear();
  return header;
}

absl::Status check_files(const DenoiseOptions& options) {
  if (options.input == options.output) {
    return absl::InvalidArgumentError(
        absl::StrCat("--output ", options.output, ": same path as the input"));
  }
  if (!options.force && ::access(options.output.c_str(), F_OK) == 0) {
    return absl::AlreadyExistsError(
        absl::StrCat(options.output, " already exists; use --force to overwrite"));
  }
  return absl::OkStatus();
}

/// Denoises band by band into `path`.
absl::StatusOr<image::DenoisedError> denoise_to(image::ExrReader& reader, int threads,
                                                const std::string& path) {
  const contract::PixelRect& window = reader.header().data_window;
  std::vector<image::ExrPlane> planes = reader.planes();
  image::FrameDenoiser denoiser(window.width, window.height, mean_luminance(reader.header()),
                                planes, threads);
  auto writer = image::ExrWriter::open(path, output_header(reader.header()), denoiser.planes());
  if (!writer.ok()) return writer.status();
  const auto sink = [&](std::int32_t rows, const std::vector<image::ExrPlane>& denoised) {
    return (*writer)->write_rows(rows, denoised);
  };
  for (std::int32_t row = 0; row < window.height; row += kBandRows) {
    const std::int32_t rows = std::min(kBandRows, window.height - row);
    absl::Status status = reader.read_rows(rows, planes);
    if (status.ok()) status = denoiser.push(rows, planes, sink);
    if (!status.ok()) return status;
  }
  if (absl::Status status = (*writer)->close(); !status.ok()) return status;
  return denoiser.error();
}

int run(const DenoiseOptions& options) {
  if (absl::Status status = check_files(options); !status.ok()) return fail(status);
  auto reader = image::ExrReader::open(options.input);
  if (!reader.ok()) return fail(reader.status());
  if (!image::FrameDenoiser::has_layers((*reader)->planes())) {
    return fail(absl::InvalidArgumentError(absl::StrCat(
        options.input, ": has no layers for denoising; render it with --aov denoising")));
  }
  const int cores = static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));
  const std::string part = options.output + ".part";
  const auto error = denoise_to(**reader, options.threads > 0 ? options.threads : cores, part);
  if (!error.ok()) {
    std::remove(part.c_str());
    return fail(error.status());
  }
  if (std::rename(part.c_str(), options.output.c_str()) != 0) {
    return fail(absl::FailedPreconditionError(absl::StrCat(options.output, ": cannot be written")));
  }
  Table table({"error", absl::StrFormat("%.4g", error->error)});
  table.add({"error_upper95", absl::StrFormat("%.4g", error->error_upper95)});
  table.add({"left raw", absl::StrFormat("%.1f %%", 100 * error->raw_share)});
  std::fputs(table.text().c_str(), stdout);
  return kExitDone;
}

}  // namespace

void add_denoise_command(CLI::App& app, Invocation& invocation) {
  auto options = std::make_shared<DenoiseOptions>();
  CLI::App* command = cli::add_command(app, "denoise", "Denoise a rendered EXR file");
  command->add_option("image", options->input, "EXR file rendered with --aov denoising")
      ->type_name("IN.exr")
      ->required();
  command->add_option("-o,--output", options->output, "Denoised EXR file")
      ->type_name("OUT.exr")
      ->required();
  command->add_option("--threads", options->threads, "Threads (default: all cores)")
      ->check(CLI::Range(1, 1024));
  command->add_flag("--force", options->force, "Overwrite an existing file");
  command->footer(
      "The output equals that of `render --denoise` bit for bit, for any number of threads.\n"
      "Example:\n"
      "  tessera render scene.glb --spp 64 --aov denoising -o raw.exr\n"
      "  tessera denoise raw.exr -o out.exr");
  command->callback(
      [options, &invocation] { invocation.run = [options] { return run(*options); }; });
}

}  // namespace tessera::client
