#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>

#include "client/cli/command.h"
#include "client/output/image_file.h"
#include "tests/integration/client/fake_farm.h"
#include "tests/integration/client/made_image.h"
#include "tests/support/json_schema.h"

namespace tessera::client {
namespace {

using nlohmann::json;
using ::testing::HasSubstr;

class CompareTest : public ::testing::Test {
 protected:
  CompareTest()
      : folder_(std::filesystem::temp_directory_path() /
                ("tessera_compare_" + std::to_string(::getpid()))) {
    std::filesystem::create_directories(folder_);
  }
  ~CompareTest() override { std::filesystem::remove_all(folder_); }

  /// Writes an image whose `channels` channels all have one value; the extension chooses the
  /// format.
  std::string image(const std::string& name, float value, int channels = 4, int width = 16) const {
    std::string path = folder_ / name;
    const std::vector<float> pixels(static_cast<std::size_t>(width * 8 * channels), value);
    write_image(path, width, 8, channels, pixels);
    return path;
  }

  std::filesystem::path folder_;
};

TEST_F(CompareTest, PrintsEveryMetric) {
  const Outcome outcome =
      run_client({"compare", image("a.exr", 0.5f), image("b.exr", 0.25f), "--json"});
  EXPECT_EQ(outcome.exit, kExitDone) << outcome.err;
  EXPECT_THAT(support::document_faults(outcome.out), ::testing::IsEmpty()) << outcome.out;
  const json document = json::parse(outcome.out);
  EXPECT_NEAR(document["rmse"].get<double>(), 0.25, 1e-12);
  EXPECT_EQ(document["largest"], 0.25);
  EXPECT_GT(document["flip"], 0.1);
  const Outcome text = run_client({"compare", image("a.exr", 0.5f), image("b.exr", 0.25f)});
  for (const char* metric : {"rmse", "relmse", "error", "psnr", "flip", "largest"}) {
    EXPECT_THAT(text.out, HasSubstr(metric));
  }
}

TEST_F(CompareTest, ExitsWithOneAboveLimit) {
  const std::string a = image("a.exr", 0.5f), b = image("b.exr", 0.25f);
  EXPECT_EQ(run_client({"compare", a, b, "--fail-above", "rmse=0.24"}).exit, kExitJobFailed);
  EXPECT_EQ(run_client({"compare", a, b, "--fail-above", "rmse=0.26"}).exit, kExitDone);
  const Outcome two = run_client(
      {"compare", a, b, "--json", "--fail-above", "rmse=1", "--fail-above", "largest=0.1"});
  EXPECT_EQ(two.exit, kExitJobFailed);
  EXPECT_EQ(json::parse(two.out)["exceeded"], json({"largest"}));
  EXPECT_EQ(run_client({"compare", a, a, "--fail-above", "largest=0"}).exit, kExitDone);
}

TEST_F(CompareTest, UndefinedErrorExceedsEveryLimit) {
  const std::string a = image("a.exr", 0.5f), black = image("b.exr", 0);
  EXPECT_EQ(run_client({"compare", a, black, "--fail-above", "error=1000"}).exit, kExitJobFailed);
  EXPECT_EQ(run_client({"compare", black, black, "--fail-above", "error=0"}).exit, kExitDone);
}

TEST_F(CompareTest, RejectsWrongLimitsFilesAndSizes) {
  const std::string a = image("a.exr", 0.5f), wide = image("w.exr", 0.5f, 4, 32);
  for (const char* limit : {"rmse", "beauty=1", "rmse=", "rmse=-1", "rmse=nan", "psnr_db=30"}) {
    EXPECT_EQ(run_client({"compare", a, a, "--fail-above", limit}).exit, kExitBadInput) << limit;
  }
  EXPECT_EQ(run_client({"compare", a, folder_ / "none.exr"}).exit, kExitBadInput);
  const Outcome sizes = run_client({"compare", a, wide});
  EXPECT_EQ(sizes.exit, kExitBadInput);
  EXPECT_THAT(sizes.err, HasSubstr("16x8 and 32x8"));
  std::ofstream(folder_ / "text.exr") << "hello";
  const Outcome text = run_client({"compare", a, folder_ / "text.exr"});
  EXPECT_EQ(text.exit, kExitBadInput);
  EXPECT_THAT(text.err, HasSubstr("text.exr"));
}

TEST_F(CompareTest, ExplainsUnreadableFiles) {
  const std::string a = image("a.exr", 0.5f), empty = folder_ / "empty.exr";
  std::ofstream(empty).flush();
  const std::pair<std::string, const char*> files[] = {
      {folder_ / "none.exr", "none.exr: No such file or directory"},
      {folder_, ": Is a directory"},
      {empty, "empty.exr: the file is empty"}};
  for (const auto& [file, fault] : files) {
    const Outcome outcome = run_client({"compare", a, file});
    EXPECT_EQ(outcome.exit, kExitBadInput);
    EXPECT_THAT(outcome.err, HasSubstr(fault));
  }
}

TEST_F(CompareTest, RejectsNonFinitePixels) {
  // Hard case 70: a metric that skips such values would hide the fault.
  const std::string a = image("a.exr", 0.5f);
  const std::string bad = image("bad.exr", std::numeric_limits<float>::quiet_NaN());
  const Outcome outcome = run_client({"compare", bad, a});
  EXPECT_EQ(outcome.exit, kExitBadInput);
  EXPECT_THAT(outcome.err, HasSubstr("not finite"));
}

TEST_F(CompareTest, DecodesLinearAndSrgbImages) {
  const auto linear = read_image(image("a.exr", 0.5f, 3));
  ASSERT_TRUE(linear.ok()) << linear.status();
  EXPECT_EQ(linear->rgba[0], 0.5f);
  EXPECT_EQ(linear->rgba[3], 1.0f) << "no alpha is opaque";
  const auto encoded = read_image(image("a.png", 0.5f, 3));
  ASSERT_TRUE(encoded.ok()) << encoded.status();
  EXPECT_NEAR(encoded->rgba[0], std::pow((128 / 255.0 + 0.055) / 1.055, 2.4), 1e-6);
}

TEST_F(CompareTest, DetectsFormatByContent) {
  const std::string png = image("a.png", 0.5f, 3);
  const std::string renamed = folder_ / "a.exr";
  std::filesystem::rename(png, renamed);
  EXPECT_TRUE(read_image(renamed).ok());
}

}  // namespace
}  // namespace tessera::client
