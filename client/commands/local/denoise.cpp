#include <sys/stat.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cerrno>
#include <cstddef>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <thread>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "cli/command.h"
#include "client/cli/table.h"
#include "client/commands/local/local_commands.h"
#include "image/denoise/frame_denoiser.h"
#include "image/denoise/frames/frame_fusion.h"
#include "image/denoise/layers.h"
#include "image/exr/exr_file.h"

namespace tessera::client {
namespace {

constexpr std::int32_t kBandRows = 64;

struct DenoiseOptions {
  std::vector<std::string> inputs;
  std::string output;
  bool animation = false;
  int threads = 0;
  bool force = false, json = false;
};

/// A file that was written.
struct DenoisedFile {
  std::string input, output;
  std::optional<int> frame;  // its number; nullopt if the file does not say
  bool has_scale = false;    // errors are relative to the mean luminance, which may be unknown
  image::DenoisedError error;
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

absl::Status check_files(const std::string& input, const std::string& output, bool force) {
  struct ::stat from {
  }, to{};
  if (input == output || (::stat(input.c_str(), &from) == 0 && ::stat(output.c_str(), &to) == 0 &&
                          from.st_dev == to.st_dev && from.st_ino == to.st_ino)) {
    return absl::InvalidArgumentError(
        absl::StrCat("--output ", output, ": same file as the input"));
  }
  if (output.size() < 4 || output.substr(output.size() - 4) != ".exr") {
    return absl::InvalidArgumentError(
        absl::StrCat("--output ", output, ": denoised images are OpenEXR files, name.exr"));
  }
  if (!force && ::access(output.c_str(), F_OK) == 0) {
    return absl::AlreadyExistsError(
        absl::StrCat(output, " already exists; use --force to overwrite"));
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

/// Copies `count` pixels from pixel `first` on.
void cut_band(const std::vector<image::ExrPlane>& planes, std::ptrdiff_t first,
              std::ptrdiff_t count, std::vector<image::ExrPlane>& band) {
  const auto cut = [&](const auto& from, auto& to) {
    if (!from.empty()) to.assign(from.begin() + first, from.begin() + first + count);
  };
  for (std::size_t k = 0; k < planes.size(); ++k) {
    cut(planes[k].values, band[k].values);
    cut(planes[k].words, band[k].words);
  }
}

/// Calls write(path) for a file that is renamed to `output` when it is complete.
template <typename Write>
absl::StatusOr<image::DenoisedError> write_output(const std::string& output, const Write& write) {
  const std::string part = output + ".part";
  absl::StatusOr<image::DenoisedError> error = write(part);
  if (!error.ok()) {
    std::remove(part.c_str());
  } else if (std::rename(part.c_str(), output.c_str()) != 0) {
    return absl::FailedPreconditionError(absl::StrCat(output, ": cannot be written"));
  }
  return error;
}

/// The frame's number; nullopt if the file does not say.
std::optional<int> frame_number(const image::ExrHeader& header) {
  for (const auto& [name, value] : header.numbers) {
    if (name == "tessera:frame") return value;
  }
  return std::nullopt;
}

nlohmann::ordered_json document_of(const std::vector<DenoisedFile>& files) {
  nlohmann::ordered_json frames = nlohmann::ordered_json::array();
  for (const DenoisedFile& file : files) {
    const auto if_scaled = [&file](double value) {
      return file.has_scale ? nlohmann::ordered_json(value) : nlohmann::ordered_json(nullptr);
    };
    frames.push_back({{"input", file.input},
                      {"output", file.output},
                      {"frame", nullptr},
                      {"error_denoised", if_scaled(file.error.error)},
                      {"error_denoised_upper95", if_scaled(file.error.error_upper95)},
                      {"n_eff", if_scaled(file.error.n_eff)},
                      {"raw_tile_share", file.error.raw_share}});
    if (file.frame) frames.back()["frame"] = *file.frame;
  }
  return {{"schema", "tessera.denoise/1"}, {"frames", std::move(frames)}};
}

/// A line for each frame of an animation, or a list for a single file.
std::string text_of(const std::vector<DenoisedFile>& files, bool animation) {
  if (!animation) {
    const image::DenoisedError& error = files.front().error;
    Table table({"error", absl::StrFormat("%.4g", error.error)});
    table.add({"error_upper95", absl::StrFormat("%.4g", error.error_upper95)});
    table.add({"left raw", absl::StrFormat("%.1f %%", 100 * error.raw_share)});
    return table.text();
  }
  Table table({"frame", "error", "error_upper95", "left raw"});
  for (const DenoisedFile& file : files) {
    table.add({file.frame ? absl::StrCat(*file.frame) : "-",
               absl::StrFormat("%.4g", file.error.error),
               absl::StrFormat("%.4g", file.error.error_upper95),
               absl::StrFormat("%.1f %%", 100 * file.error.raw_share)});
  }
  return table.text();
}

int print_files(const DenoiseOptions& options, const std::vector<DenoisedFile>& files) {
  const std::string text =
      options.json ? document_of(files).dump(2) + "\n" : text_of(files, options.animation);
  std::fputs(text.c_str(), stdout);
  return kExitDone;
}

int run_single(const DenoiseOptions& options, int threads) {
  const std::string& input = options.inputs.front();
  absl::Status status = check_files(input, options.output, options.force);
  if (!status.ok()) return fail(status);
  auto reader = image::ExrReader::open(input);
  if (!reader.ok()) return fail(reader.status());
  if (!image::FrameDenoiser::has_layers((*reader)->planes())) {
    return fail(absl::InvalidArgumentError(
        absl::StrCat(input, ": has no layers for denoising; render it with --aov denoising")));
  }
  const auto error = write_output(
      options.output, [&](const std::string& part) { return denoise_to(**reader, threads, part); });
  if (!error.ok()) return fail(error.status());
  const image::ExrHeader& header = (*reader)->header();
  return print_files(
      options, {{input, options.output, frame_number(header), mean_luminance(header) > 0, *error}});
}

/// A frame of an animation in memory.
struct LoadedFrame {
  std::string path;
  image::ExrHeader header;
  std::vector<image::ExrPlane> planes;
  std::optional<image::AnimationFrame> frame;
};

absl::StatusOr<std::unique_ptr<LoadedFrame>> load_frame(const std::string& path, int threads) {
  auto reader = image::ExrReader::open(path);
  if (!reader.ok()) return reader.status();
  auto loaded = std::make_unique<LoadedFrame>();
  loaded->path = path;
  loaded->header = (*reader)->header();
  loaded->planes = (*reader)->planes();
  if (!image::FrameDenoiser::has_motion(loaded->planes)) {
    return absl::InvalidArgumentError(absl::StrCat(
        path, ": lacks layers for denoising an animation; render it with --aov denoising,motion"));
  }
  const contract::PixelRect& window = loaded->header.data_window;
  absl::Status status = (*reader)->read_rows(window.height, loaded->planes);
  if (!status.ok()) return status;
  loaded->frame = image::animation_frame(window.width, window.height,
                                         mean_luminance(loaded->header), loaded->planes, threads);
  return loaded;
}

/// Whether `next` shows the same part of the image one frame later.
absl::Status check_order(const LoadedFrame& frame, const LoadedFrame& next) {
  const std::optional<int> number = frame_number(frame.header), later = frame_number(next.header);
  if (!number || !later || *later != *number + 1) {
    return absl::InvalidArgumentError(absl::StrCat(next.path, ": is not the frame after that of ",
                                                   frame.path,
                                                   "; pass consecutive frames in order"));
  }
  if (frame.header.data_window != next.header.data_window) {
    return absl::InvalidArgumentError(
        absl::StrCat(next.path, ": has another size or crop than ", frame.path));
  }
  return absl::OkStatus();
}

/// Denoises a frame of an animation into `path`. The neighbours may be null.
absl::StatusOr<image::DenoisedError> denoise_frame(const LoadedFrame& loaded,
                                                   const LoadedFrame* before,
                                                   const LoadedFrame* after, int threads,
                                                   const std::string& path) {
  const auto frame_of = [](const LoadedFrame* other) {
    return other == nullptr ? nullptr : &*other->frame;
  };
  const bool alone = before == nullptr && after == nullptr;
  const image::FusedFrame fused =
      alone ? image::FusedFrame{}
            : image::fuse_frames(*loaded.frame, frame_of(before), frame_of(after), threads);
  const image::AnimationInput input{*loaded.frame, fused};
  const contract::PixelRect& window = loaded.header.data_window;
  image::FrameDenoiser denoiser(window.width, window.height, mean_luminance(loaded.header),
                                loaded.planes, threads, alone ? nullptr : &input);
  auto writer = image::ExrWriter::open(path, output_header(loaded.header), denoiser.planes());
  if (!writer.ok()) return writer.status();
  const auto sink = [&](std::int32_t rows, const std::vector<image::ExrPlane>& denoised) {
    return (*writer)->write_rows(rows, denoised);
  };
  std::vector<image::ExrPlane> band;
  for (const image::ExrPlane& plane : loaded.planes)
    band.push_back({plane.name, plane.type, {}, {}});
  for (std::int32_t row = 0; row < window.height; row += kBandRows) {
    const std::int32_t rows = std::min(kBandRows, window.height - row);
    cut_band(loaded.planes, std::ptrdiff_t{row} * window.width, std::ptrdiff_t{rows} * window.width,
             band);
    if (absl::Status status = denoiser.push(rows, band, sink); !status.ok()) return status;
  }
  if (absl::Status status = (*writer)->close(); !status.ok()) return status;
  return denoiser.error();
}

/// `output`/NAME of an input DIRECTORY/NAME.
std::string output_path(const std::string& directory, const std::string& input) {
  return absl::StrCat(directory, "/", input.substr(input.rfind('/') + 1));
}

int run_animation(const DenoiseOptions& options, int threads) {
  std::set<std::string> outputs;
  for (const std::string& input : options.inputs) {
    if (!outputs.insert(output_path(options.output, input)).second) {
      return fail(absl::InvalidArgumentError(
          absl::StrCat(input, ": another input has the same file name")));
    }
    absl::Status status = check_files(input, output_path(options.output, input), options.force);
    if (!status.ok()) return fail(status);
  }
  struct ::stat folder {};
  if ((::mkdir(options.output.c_str(), 0777) != 0 && errno != EEXIST) ||
      ::stat(options.output.c_str(), &folder) != 0 || !S_ISDIR(folder.st_mode)) {
    return fail(absl::FailedPreconditionError(
        absl::StrCat(options.output, ": cannot be created as a directory")));
  }
  std::vector<DenoisedFile> files;
  std::unique_ptr<LoadedFrame> before, frame, after;
  for (std::size_t i = 0; i < options.inputs.size(); ++i) {
    for (const std::size_t next : {i, i + 1}) {
      if (next >= options.inputs.size() || (next == i && frame != nullptr)) continue;
      auto loaded = load_frame(options.inputs[next], threads);
      if (!loaded.ok()) return fail(loaded.status());
      (next == i ? frame : after) = *std::move(loaded);
    }
    if (after != nullptr) {
      if (absl::Status status = check_order(*frame, *after); !status.ok()) return fail(status);
    }
    const std::string output = output_path(options.output, frame->path);
    const auto error = write_output(output, [&](const std::string& part) {
      return denoise_frame(*frame, before.get(), after.get(), threads, part);
    });
    if (!error.ok()) return fail(error.status());
    files.push_back({frame->path, output, frame_number(frame->header),
                     mean_luminance(frame->header) > 0, *error});
    before = std::move(frame);
    frame = std::exchange(after, nullptr);
  }
  return print_files(options, files);
}

int run(const DenoiseOptions& options) {
  const int cores = static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));
  const int threads = options.threads > 0 ? options.threads : cores;
  if (options.animation) return run_animation(options, threads);
  if (options.inputs.size() > 1) {
    return fail(absl::InvalidArgumentError(
        "several files are denoised as the frames of an animation only; add --animation"));
  }
  return run_single(options, threads);
}

}  // namespace

void add_denoise_command(CLI::App& app, Invocation& invocation) {
  auto options = std::make_shared<DenoiseOptions>();
  CLI::App* command = cli::add_command(app, "denoise", "Denoise rendered EXR files");
  command
      ->add_option("images", options->inputs,
                   "EXR file rendered with --aov denoising; with --animation, consecutive frames")
      ->type_name("IN.exr")
      ->required();
  command
      ->add_option("-o,--output", options->output,
                   "Denoised EXR file; with --animation, directory of the denoised files")
      ->type_name("OUT.exr")
      ->required();
  command->add_flag("--animation", options->animation,
                    "Denoise each frame with the help of the previous and the next one; they need "
                    "--aov denoising,motion");
  command->add_option("--threads", options->threads, "Threads (default: all cores)")
      ->check(CLI::Range(1, 1024));
  command->add_flag("--force", options->force, "Overwrite an existing file");
  command->add_flag("--json", options->json, "Print JSON (tessera.denoise/1)");
  command->footer(
      "Any number of threads gives the same bits. Without --animation, the output equals that of\n"
      "`render --denoise` bit for bit.\n"
      "Example:\n"
      "  tessera render scene.glb --spp 64 --aov denoising -o raw.exr\n"
      "  tessera denoise raw.exr -o out.exr\n"
      "  tessera render scene.glb --frames 0-23 --spp 64 --aov denoising,motion -o raw.exr\n"
      "  tessera denoise --animation raw.*.exr -o denoised");
  command->callback(
      [options, &invocation] { invocation.run = [options] { return run(*options); }; });
}

}  // namespace tessera::client
