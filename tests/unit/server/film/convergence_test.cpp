#include "server/film/convergence.h"

#include <gtest/gtest.h>

#include "server/film/frame_summary.h"

namespace tessera::server {
namespace {

/// Statistics of a frame that meets its target error of 0.1.
FrameStatistics good() {
  FrameStatistics statistics;
  statistics.mean_luminance = 0.5;
  statistics.estimated.pixels = 4096;
  statistics.estimated.error = 0.08;
  statistics.estimated.error_upper95 = 0.09;
  statistics.estimated.n_eff = 900;
  return statistics;
}

contract::RenderSettings target() {
  contract::RenderSettings settings;
  settings.error = 0.1;
  return settings;
}

TEST(Certainty, BoundOfDenoisedImageDecides) {
  FrameStatistics statistics = good();
  statistics.estimated.error_upper95 = 0.3;
  statistics.denoised = DenoisedStatistics{0.05, 0.09, 200, 0, {}};
  EXPECT_EQ(assess_convergence(statistics, {9, 0, false}, target()).certainty,
            Certainty::converged);
  statistics.denoised->error_upper95 = 0.11;
  EXPECT_EQ(assess_convergence(statistics, {9, 6, false}, target()).certainty, Certainty::capped);
  statistics.denoised->n_eff = 20;
  EXPECT_EQ(assess_convergence(statistics, {9, 6, false}, target()).certainty, Certainty::uncertain)
      << "few pixels carry the error";
}

TEST(Certainty, RawBoundCountsIfFewPixelsCarryError) {
  for (const double denoised : {20, 200}) {
    for (const double raw : {20, 200}) {
      FrameStatistics statistics = good();
      statistics.estimated.error_upper95 = 0.095;
      statistics.estimated.n_eff = raw;
      statistics.denoised = DenoisedStatistics{0.05, 0.06, denoised, 0, {}};
      statistics.denoised->widen_bound(statistics.estimated);
      const bool is_wide = denoised == 20 || raw == 20;
      EXPECT_EQ(statistics.denoised->error_upper95, is_wide ? 0.095 : 0.06);
      EXPECT_EQ(assess_convergence(statistics, {9, 0, false}, target()).certainty,
                Certainty::converged);
      statistics.estimated.error_upper95 = 0.11;
      statistics.denoised->widen_bound(statistics.estimated);
      EXPECT_EQ(assess_convergence(statistics, {9, 0, false}, target()).certainty,
                is_wide ? Certainty::uncertain : Certainty::converged);
    }
  }
}

TEST(Certainty, ConvergedNeedsNoContraryReason) {
  const ConvergenceResult claim = assess_convergence(good(), {9, 0, false}, target());
  EXPECT_EQ(claim.certainty, Certainty::converged);
  EXPECT_TRUE(claim.reasons.empty());
  EXPECT_EQ(assess_convergence(good(), {9, 5, false}, target()).certainty, Certainty::converged)
      << "capped tiles are allowed if the bound is met";

  const auto uncertain = [](const FrameStatistics& statistics, const StoppingStats& stopping) {
    const ConvergenceResult doubtful = assess_convergence(statistics, stopping, target());
    EXPECT_FALSE(doubtful.reasons.empty());
    return doubtful.certainty == Certainty::uncertain;
  };
  FrameStatistics statistics = good();
  statistics.mean_luminance = 0;
  EXPECT_TRUE(uncertain(statistics, {9, 0, false})) << "black";
  statistics = good();
  statistics.dropped_samples = 1;
  EXPECT_TRUE(uncertain(statistics, {9, 0, false})) << "a sample that was not finite";
  statistics = good();
  statistics.clamped_energy = 1e-3;
  EXPECT_TRUE(uncertain(statistics, {9, 0, false})) << "--clamp removed light";
  statistics = good();
  statistics.estimated.error_upper95 = 0.11;
  EXPECT_TRUE(uncertain(statistics, {9, 0, false}))
      << "the bound is missed with no tile at the cap";
}

TEST(Certainty, CappedOnlyIfBoundIsMissed) {
  FrameStatistics statistics = good();
  statistics.estimated.error_upper95 = 0.11;
  EXPECT_EQ(assess_convergence(statistics, {9, 3, false}, target()).certainty, Certainty::capped);
  statistics.dropped_samples = 1;
  const ConvergenceResult claim = assess_convergence(statistics, {9, 3, false}, target());
  EXPECT_EQ(claim.certainty, Certainty::uncertain);
  ASSERT_EQ(claim.reasons.size(), 2u);
  EXPECT_EQ(claim.reasons[1],
            "the 95 % error bound is 0.11, above the target 0.1; tiles that reached --max-spp: 3")
      << "also where it is not the only reason";
}

TEST(Certainty, ConcentratedErrorWithWideBoundMayConverge) {
  FrameStatistics statistics = good();
  statistics.estimated.n_eff = 12;
  EXPECT_EQ(assess_convergence(statistics, {9, 0, false}, target()).certainty,
            Certainty::converged);
  statistics.estimated.error_upper95 = 0.11;
  EXPECT_EQ(assess_convergence(statistics, {9, 3, false}, target()).certainty, Certainty::uncertain)
      << "the bound says little";
  contract::RenderSettings unguided = target();
  unguided.guiding = false;
  const ConvergenceResult futile = assess_convergence(statistics, {9, 0, true}, unguided);
  EXPECT_EQ(futile.certainty, Certainty::uncertain);
  ASSERT_EQ(futile.reasons.size(), 2u);
  EXPECT_EQ(futile.reasons[0],
            "the error is concentrated in few pixels (effectively 12), so its bound is wide; "
            "the samples left up to --max-spp would not meet the target; "
            "without --no-guiding there is less noise where light comes through glass or narrow "
            "openings");
  EXPECT_EQ(assess_convergence(statistics, {9, 3, false}, target()).reasons[0],
            "the error is concentrated in few pixels (effectively 12), so its bound is wide");
}

TEST(Certainty, NamesRoundTrip) {
  for (const Certainty each : {Certainty::converged, Certainty::capped, Certainty::uncertain}) {
    EXPECT_EQ(parse_certainty(certainty_name(each)), each);
  }
  EXPECT_EQ(parse_certainty("DONE"), std::nullopt);
}

TEST(FrameSummary, JournalRoundTrip) {
  FrameSummary summary;
  summary.spp = 16384;
  summary.error = 0.05;
  summary.samples = 123456789012;
  summary.unit_count = 77;
  summary.certainty = Certainty::capped;
  summary.warnings = {"one"};
  summary.reasons = {"two", "three"};
  summary.entry_json = R"({"frame":3})";
  EXPECT_EQ(read_frame_summary(write_frame_summary(summary)), summary);
  summary.error.reset();
  summary.certainty.reset();
  EXPECT_EQ(read_frame_summary(write_frame_summary(summary)), summary);
  contract::RenderSettings settings;
  settings.spp = 16384;
  EXPECT_TRUE(summary.fits(settings));
  settings.error = 0.05;
  EXPECT_FALSE(summary.fits(settings)) << "finished for a fixed count";
  EXPECT_EQ(read_frame_summary("no JSON").spp, 0);
}

}  // namespace
}  // namespace tessera::server
