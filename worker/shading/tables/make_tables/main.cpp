// Writes the tables of albedos that do not depend on the scene, as C++ arrays, when Tessera is
// built. Usage: tessera-make-tables FOLDER
#include <algorithm>
#include <cstdio>
#include <string>
#include <vector>

#include "worker/shading/microfacet/half_circle.h"
#include "worker/shading/tables/albedo_grid.h"
#include "worker/shading/tables/anisotropic_albedo.h"
#include "worker/shading/tables/facet_albedo.h"
#include "worker/shading/tables/facet_quadrature.h"
#include "worker/shading/tables/sheen.h"

namespace tessera::render {
namespace {

using Values = std::vector<double>;

/// Axis of a table: its nodes, and their distance in the array.
struct Axis {
  std::size_t count, stride;
};

/// Values raised by the error of interpolation along the axes, or lowered by it, and by `margin`
/// for the error of the quadrature.
Values rounded(const Values& values, const std::vector<Axis>& axes, double margin, bool up) {
  constexpr double kSafety = 1.2;
  Values bound(values.size(), margin);
  for (const Axis& axis : axes) {
    albedo_grid::add_interpolation_error(values, axis.count, axis.stride, up, kSafety, bound);
  }
  Values result(values.size());
  for (std::size_t i = 0; i < values.size(); ++i) {
    result[i] = up ? values[i] + bound[i] : std::max(values[i] - bound[i], 0.0);
  }
  return result;
}

/// Two tables with alternating entries.
Values interleaved(const Values& a, const Values& b) {
  Values all;
  for (std::size_t i = 0; i < a.size(); ++i) {
    all.push_back(a[i]);
    all.push_back(b[i]);
  }
  return all;
}

/// Appends a definition of `name` as an array to the file.
void write(std::FILE* file, const char* name, const Values& values) {
  std::fprintf(file, "inline constexpr std::array<float, %zu> %s = {", values.size(), name);
  for (std::size_t i = 0; i < values.size(); ++i) {
    std::fprintf(file, "%s%.9ef", i % 8 == 0 ? "\n" : "", static_cast<double>(values[i]));
    std::fputs(i + 1 < values.size() ? "," : "};\n", file);
  }
}

Vec3d direction(double cosine, double x, double y) {
  const double sine = std::sqrt((1 - cosine) * (1 + cosine));
  return {sine * x, sine * y, cosine};
}

void write_facets(std::FILE* file) {
  const VisibleNormals normals(2048), coarse(512);
  Values a, b, mean_a, mean_b;
  for (std::size_t r = 0; r < kFacetRows; ++r) {
    const double roughness = albedo_grid::roughness_of(albedo_grid::node(r, kFacetRows));
    const double alpha = roughness * roughness;
    for (std::size_t i = 0; i < kFacetHeights; ++i) {
      const double c = albedo_grid::cosine_of(albedo_grid::node(i, kFacetHeights), alpha);
      const SchlickAlbedo e = schlick_albedo(normals, direction(c, 1, 0), alpha, alpha);
      a.push_back(e.a);
      b.push_back(e.b);
    }
    constexpr int kSteps = 256;
    SchlickAlbedo mean;
    for (int k = 0; k < kSteps; ++k) {
      const double x = (k + 0.5) / kSteps;
      const SchlickAlbedo e = schlick_albedo(coarse, direction(x * x, 1, 0), alpha, alpha);
      mean.a += e.a * (4 * x * x * x / kSteps);
      mean.b += e.b * (4 * x * x * x / kSteps);
    }
    mean_a.push_back(mean.a);
    mean_b.push_back(mean.b);
  }
  constexpr double kError = 6e-5;  // of the quadrature
  const std::vector<Axis> axes = {{kFacetHeights, 1}, {kFacetRows, kFacetHeights}};
  const std::vector<Axis> row = {{kFacetRows, 1}};
  write(file, "kFacetNodes",
        interleaved(rounded(a, axes, kError, true), rounded(b, axes, kError, true)));
  write(file, "kFacetMeans",
        interleaved(rounded(mean_a, row, 3e-5, false), rounded(mean_b, row, 1e-5, false)));
}

/// Mean over the hemisphere: cosines are squares, azimuths over a quarter turn.
SchlickAlbedo anisotropic_mean(const VisibleNormals& normals, double at, double ab) {
  static const HalfCircle<8> circle;
  constexpr int kSteps = 32;
  SchlickAlbedo mean;
  for (int i = 0; i < kSteps; ++i) {
    const double x = (i + 0.5) / kSteps, share = 4 * x * x * x / (kSteps * 4);
    for (std::size_t k = 0; k < 4; ++k) {
      const Vec3d wo = direction(x * x, circle.cosine[k], circle.sine[k]);
      const SchlickAlbedo e = schlick_albedo(normals, wo, at, ab);
      mean.a += e.a * share;
      mean.b += e.b * share;
    }
  }
  return mean;
}

void write_anisotropic(std::FILE* file) {
  using Table = AnisotropicAlbedo;
  const VisibleNormals normals(512), coarse(128);
  Values a, b, mean_a, mean_b;
  for (std::size_t s = 0; s < Table::kAlphas; ++s) {
    for (std::size_t r = 0; r < Table::kRows; ++r) {
      const double roughness = albedo_grid::roughness_of(albedo_grid::node(r, Table::kRows));
      const double ab = std::max(roughness * roughness, double{kMirrorAlpha});
      const double at = Table::alpha_t_of(albedo_grid::node(s, Table::kAlphas), ab);
      for (std::size_t k = 0; k < Table::kPlanes; ++k) {
        const double fine =
            lerp(albedo_grid::fineness_of(std::sqrt(ab)), albedo_grid::fineness_of(std::sqrt(at)),
                 albedo_grid::node(k, Table::kPlanes));
        const double root = albedo_grid::roughness_of(fine);
        const double alpha = root * root, range = (at - ab) * (at + ab);
        const double along = range > 0 ? clamp((alpha - ab) * (alpha + ab) / range, 0.0, 1.0) : 0.5;
        for (std::size_t i = 0; i < Table::kHeights; ++i) {
          const double c = albedo_grid::cosine_of(albedo_grid::node(i, Table::kHeights), alpha);
          const Vec3d wo = direction(c, std::sqrt(along), std::sqrt(1 - along));
          const SchlickAlbedo e = schlick_albedo(normals, wo, at, ab);
          a.push_back(e.a);
          b.push_back(e.b);
        }
      }
      const SchlickAlbedo mean = anisotropic_mean(coarse, at, ab);
      mean_a.push_back(mean.a);
      mean_b.push_back(mean.b);
    }
  }
  constexpr std::size_t kPlane = Table::kHeights, kLobe = kPlane * Table::kPlanes;
  const std::vector<Axis> axes = {{Table::kHeights, 1},
                                  {Table::kPlanes, kPlane},
                                  {Table::kRows, kLobe},
                                  {Table::kAlphas, kLobe * Table::kRows}};
  const std::vector<Axis> lobes = {{Table::kRows, 1}, {Table::kAlphas, Table::kRows}};
  write(file, "kAnisotropicNodes",
        interleaved(rounded(a, axes, 3e-4, true), rounded(b, axes, 3e-4, true)));
  write(file, "kAnisotropicMeans",
        interleaved(rounded(mean_a, lobes, 4e-4, false), rounded(mean_b, lobes, 4e-4, false)));
}

/// Albedo of white sheen by the midpoint rule over the light's azimuth and the root of its cosine.
double sheen_albedo_at(double cos_o, double alpha, const HalfCircle<32>& circle) {
  constexpr int kSteps = 128;
  const double sin_o = std::sqrt((1 - cos_o) * (1 + cos_o));
  const double lambda_o = sheen_lambda(cos_o, alpha);
  double sum = 0;
  for (int i = 0; i < kSteps; ++i) {
    const double t = (i + 0.5) / kSteps, z = t * t;
    const double s = std::sqrt((1 - z) * (1 + z));
    const double share = 2 * t / (4 * cos_o * (1 + lambda_o + sheen_lambda(z, alpha)));
    for (std::size_t k = 0; k < 32; ++k) {
      const double x = sin_o + s * circle.cosine[k], y = s * circle.sine[k], up = cos_o + z;
      const double across = x * x + y * y;
      sum += share * sheen_d(across / (across + up * up), alpha);
    }
  }
  return sum * 6.28318530717958647693 / (kSteps * 32);
}

void write_sheen(std::FILE* file) {
  const HalfCircle<32> circle;
  Values values;
  for (std::size_t r = 0; r < kSheenRows; ++r) {
    const double least{kMinSheenRoughness};
    const double roughness = least + (1 - least) * albedo_grid::node(r, kSheenRows);
    for (std::size_t i = 0; i < kSheenCosines; ++i) {
      // A cosine of exactly zero divides by zero; interpolation needs the limit.
      constexpr double kLeastCosine = 1e-5;
      const double x = albedo_grid::node(i, kSheenCosines);
      const double c = std::max(x * x * x * x, kLeastCosine);
      values.push_back(sheen_albedo_at(c, roughness * roughness, circle));
    }
  }
  write(file, "kSheenNodes",
        rounded(values, {{kSheenCosines, 1}, {kSheenRows, kSheenCosines}}, 1e-4, true));
}

int make(const std::string& folder) {
  struct Table {
    const char* name;
    void (*write)(std::FILE*);
  };
  for (const Table& table :
       {Table{"facet_albedo.inc", write_facets}, Table{"anisotropic_albedo.inc", write_anisotropic},
        Table{"sheen.inc", write_sheen}}) {
    const std::string path = folder + "/" + table.name;
    std::FILE* file = std::fopen(path.c_str(), "w");
    if (file == nullptr) return 1;
    std::fputs("namespace tessera::render {\n", file);
    table.write(file);
    std::fputs("}  // namespace tessera::render\n", file);
    if (std::fclose(file) != 0) return 1;
  }
  return 0;
}

}  // namespace
}  // namespace tessera::render

int main(int argc, char** argv) {
  if (argc == 2 && tessera::render::make(argv[1]) == 0) return 0;
  std::fputs("tessera-make-tables FOLDER: cannot write the tables there\n", stderr);
  return 1;
}
