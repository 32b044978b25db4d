#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>

#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "cli/command.h"
#include "client/cli/table.h"
#include "client/commands/local/local_commands.h"
#include "client/output/image_file.h"

namespace tessera::client {
namespace {

using nlohmann::ordered_json;

struct CompareOptions {
  std::string image, reference;
  std::vector<std::string> limits;
  bool json = false;
};

struct Limit {
  std::string metric;
  double value = 0;
};

/// Metrics for which larger is worse. An undefined error (black reference) exceeds every limit
/// unless the images are equal.
ordered_json metrics_of(const contract::ImageDifference& difference) {
  ordered_json figures = {{"rmse", difference.rmse},
                          {"relmse", difference.relmse},
                          {"error", nullptr},
                          {"flip", difference.flip},
                          {"largest", difference.largest}};
  if (difference.error) figures["error"] = *difference.error;
  return figures;
}

absl::StatusOr<std::vector<Limit>> parse_limits(const std::vector<std::string>& texts) {
  std::vector<Limit> limits;
  const ordered_json known = metrics_of({});
  for (const std::string& text : texts) {
    const std::size_t equals = text.find('=');
    Limit limit{text.substr(0, equals), 0};
    if (equals == std::string::npos || !known.contains(limit.metric) ||
        !absl::SimpleAtod(text.substr(equals + 1), &limit.value) || !(limit.value >= 0)) {
      return absl::InvalidArgumentError(
          absl::StrCat("--fail-above ", text,
                       ": expected METRIC=VALUE with rmse, relmse, error, flip or largest, and a "
                       "value of at least 0"));
    }
    limits.push_back(std::move(limit));
  }
  return limits;
}

std::string text_of(const contract::ImageDifference& difference) {
  const auto number = [](double value) { return absl::StrFormat("%.9g", value); };
  Table table({"rmse", number(difference.rmse)});
  table.add({"relmse", number(difference.relmse)});
  table.add({"error", difference.error ? number(*difference.error)
                                       : "undefined: the reference is black on average"});
  table.add({"psnr", difference.psnr_db ? number(*difference.psnr_db) + " dB" : "infinite"});
  table.add({"flip", number(difference.flip)});
  table.add({"largest", absl::StrCat(number(difference.largest), " in ",
                                     std::string(1, "RGBA"[difference.largest_channel]), " at (",
                                     difference.largest_x, ", ", difference.largest_y, ")")});
  return table.text();
}

ordered_json document_of(const CompareOptions& options, const Image& image,
                         const contract::ImageDifference& difference,
                         const std::vector<std::string>& exceeded) {
  ordered_json document = {{"schema", "tessera.compare/1"},
                           {"image", options.image},
                           {"reference", options.reference},
                           {"width", image.width},
                           {"height", image.height}};
  document.update(metrics_of(difference));
  document["psnr_db"] =
      difference.psnr_db ? ordered_json(*difference.psnr_db) : ordered_json(nullptr);
  document["largest_at"] = {{"x", difference.largest_x},
                            {"y", difference.largest_y},
                            {"channel", std::string(1, "RGBA"[difference.largest_channel])}};
  document["exceeded"] = exceeded;
  return document;
}

int run(const CompareOptions& options) {
  const auto limits = parse_limits(options.limits);
  if (!limits.ok()) return fail(limits.status());
  const auto image = read_image(options.image);
  if (!image.ok()) return fail(image.status());
  const auto reference = read_image(options.reference);
  if (!reference.ok()) return fail(reference.status());
  const auto difference = contract::compare_images(image->view(), reference->view());
  if (!difference.ok()) return fail(difference.status());

  const ordered_json figures = metrics_of(*difference);
  std::vector<std::string> exceeded;
  for (const Limit& limit : *limits) {
    const ordered_json& figure = figures[limit.metric];
    const bool over =
        figure.is_null() ? difference->largest > 0 : figure.get<double>() > limit.value;
    if (over) exceeded.push_back(limit.metric);
  }
  const std::string text = options.json
                               ? document_of(options, *image, *difference, exceeded).dump(2) + "\n"
                               : text_of(*difference);
  std::fputs(text.c_str(), stdout);
  for (const std::string& metric : exceeded) {
    std::fprintf(stderr, "tessera: %s exceeds its limit\n", metric.c_str());
  }
  return exceeded.empty() ? kExitDone : kExitJobFailed;
}

}  // namespace

void add_compare_command(CLI::App& app, Invocation& invocation) {
  auto options = std::make_shared<CompareOptions>();
  CLI::App* command =
      cli::add_command(app, "compare", "Measure how much an image differs from a reference");
  command->add_option("image", options->image, "Image file: EXR, HDR, PNG, JPEG or WebP")
      ->required();
  command->add_option("reference", options->reference, "Reference image")->required();
  command
      ->add_option(
          "--fail-above", options->limits,
          "Metric (rmse, relmse, error, flip or largest) and the value above which the exit code "
          "is 1; repeatable")
      ->type_name("METRIC=VALUE")
      ->expected(1)
      ->take_all();
  command->add_flag("--json", options->json, "Print JSON (tessera.compare/1)");
  command->footer(
      "flip is the mean LDR-FLIP at 67 pixels per degree, an estimate of the difference that a "
      "viewer sees on a display. Images with values that are not finite are rejected.\nExample:\n  "
      "tessera compare out.exr reference.exr --fail-above error=0.01");
  command->callback(
      [options, &invocation] { invocation.run = [options] { return run(*options); }; });
}

}  // namespace tessera::client
