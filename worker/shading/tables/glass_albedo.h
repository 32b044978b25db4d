#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include "worker/math/vector.h"
#include "worker/shading/tables/albedo_grid.h"

namespace tessera::render {

/// Directional albedo of single-scattering GGX facets of a dielectric, reflection and transmission
/// together, for a Fresnel term w (f0 + (1 - f0) s) and 1 beyond the critical angle. Here s is the
/// exact term, scaled so that it is 0 at normal incidence: (F - F(0)) / (1 - F(0)).
struct ScatteredAlbedo {
  float mirrors = 0;       // all facets reflect: f0 = w = 1
  float grazing_only = 0;  // f0 = 0, w = 1
  float passing = 0;       // all light passes that is not totally reflected: w = 0
  float most = 0;          // upper bound for any Fresnel term

  float at(float w_f0, float w) const {
    return w_f0 * mirrors + (w - w_f0) * grazing_only + (1 - w) * passing;
  }
};

/// The reflected part of it: w (f0 a + b) + total.
struct ReflectedAlbedo {
  float a = 0, b = 0, total = 0;
};

/// What a GlassTable contains: each part, and each roughness, costs time to compute.
struct GlassTableParts {
  bool scattered = true;                       // scattered() may be called
  bool reflected = true;                       // reflected() and mean_reflected() may be called
  float min_roughness = 0, max_roughness = 1;  // of the lobes for which that holds

  bool operator==(const GlassTableParts&) const = default;
};

/// Albedos of rough glass on one side of its surface, over cosine and roughness, rounded up as
/// facet_albedo() is. Computed in double with operations that are identical on all machines.
class GlassTable {
 public:
  /// `eta` > 0 is the index of refraction of the other side, relative to that of the viewer's;
  /// `grid_eta` sets the grid.
  GlassTable(double eta, const GlassTableParts& parts, double grid_eta);
  explicit GlassTable(double eta, const GlassTableParts& parts = {})
      : GlassTable(eta, parts, eta) {}

  ScatteredAlbedo scattered(float cosine, float roughness) const;

  /// The tabulated roughness next to that of a lobe.
  struct Row {
    const ReflectedAlbedo* nodes = nullptr;  // null: no table
    float fraction = 0;
    float alpha = 1;
    float critical = 0;  // cosine of the critical angle, or 0
  };
  Row row(float roughness) const;
  static ReflectedAlbedo reflected(const Row& row, float cosine);
  /// Cosine-weighted mean of reflected() over the hemisphere.
  ReflectedAlbedo mean_reflected(float roughness) const;

  /// Takes the larger albedos of both tables, which have the same grid and parts, and the smaller
  /// means: for dispersive materials.
  void cover(const GlassTable& other);

 private:
  static constexpr std::size_t kHeights = 40, kRows = 28;

  void fill_scattered();
  void fill_reflected();
  void fill_means();

  /// The rows on which lobes of some roughness depend.
  struct Rows {
    std::size_t first, end;
  };
  Rows rows() const;

  double eta_ = 1;
  GlassTableParts parts_;
  double critical_ = 0;                     // cosine of the critical angle of the grid, or 0
  std::vector<ScatteredAlbedo> scattered_;  // [row][height]
  std::vector<ReflectedAlbedo> reflected_;
  std::array<ReflectedAlbedo, 4 * kRows - 3> means_{};
};

}  // namespace tessera::render
