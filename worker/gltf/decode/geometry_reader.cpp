#include "worker/gltf/decode/geometry_reader.h"

#include <cmath>

#include "absl/strings/str_cat.h"
#include "worker/gltf/decode/accessor_reader.h"
#include "worker/gltf/decode/tangents.h"
#include "worker/gltf/file/limits.h"

namespace tessera::render {

namespace {

/// Reader of one primitive.
class PrimitiveReader {
 public:
  PrimitiveReader(const GltfModel& model, const GltfPrimitive& source, std::string where,
                  std::vector<Problem>& problems)
      : model_(model), source_(source), where_(std::move(where)), problems_(problems) {}

  absl::StatusOr<std::optional<BasePrimitive>> read(const VertexUsage& usage) {
    const bool solid = source_.mode >= PrimitiveMode::triangles;
    if (!solid || !source_.attributes.contains("POSITION")) {
      warn(solid ? "has no POSITION; skipped" : "points and lines are not supported; skipped");
      return std::optional<BasePrimitive>();
    }
    absl::Status status = read_positions();
    if (status.ok()) status = read_triangles();
    if (status.ok()) status = read_vectors();
    if (status.ok()) status = read_uv(usage);
    if (status.ok()) status = read_colors();
    if (status.ok()) status = read_targets();
    if (status.ok()) status = read_influences();
    if (!status.ok()) return status;
    if (const std::size_t gone = drop_invalid_triangles(out_.primitive); gone > 0) {
      warn(absl::StrCat(gone,
                        " triangles have a vertex that is NaN, infinite or beyond 1e18; "
                        "skipped"));
    }
    mend_normals();
    mend_tangents();
    if (usage.tangents && out_.primitive.tangents.empty()) {
      add_tangents(out_, usage.tangent_uv_set);
    }
    if (!usage.tangents) out_.primitive.tangents.clear();
    return std::optional<BasePrimitive>(std::move(out_));
  }

 private:
  void warn(const std::string& message) {
    problems_.push_back({Problem::Severity::warning, where_, message});
  }

  absl::Status fault(const std::string& message) const {
    return absl::InvalidArgumentError(absl::StrCat(where_, ": ", message));
  }

  /// Accessor index of an attribute, or kNone.
  std::int32_t accessor(const std::string& name) const {
    const auto it = source_.attributes.find(name);
    return it == source_.attributes.end() ? kNone : it->second;
  }

  /// Checks that the attribute has as many elements as POSITION.
  absl::Status check_count(const std::string& name, std::size_t count) const {
    if (count == vertices_) return absl::OkStatus();
    return fault(absl::StrCat(name, " has ", count, " elements, but POSITION has ", vertices_));
  }

  template <typename T>
  absl::Status take(const std::string& name, absl::StatusOr<std::vector<T>> values,
                    std::vector<T>& to) const {
    if (!values.ok()) {
      return absl::Status(values.status().code(),
                          absl::StrCat(where_, ".", name, ": ", values.status().message()));
    }
    to = *std::move(values);
    return check_count(name, to.size());
  }

  absl::Status read_positions() {
    auto positions = read_vec3(model_, accessor("POSITION"));
    if (!positions.ok()) return fault(std::string(positions.status().message()));
    vertices_ = positions->size();
    if (vertices_ > std::numeric_limits<std::uint32_t>::max()) return fault("too many vertices");
    out_.primitive.positions = *std::move(positions);
    return absl::OkStatus();
  }

  absl::Status read_triangles() {
    std::vector<std::uint32_t> corners;
    if (source_.indices == kNone) {
      corners.resize(vertices_);
      for (std::size_t i = 0; i < vertices_; ++i) corners[i] = static_cast<std::uint32_t>(i);
    } else {
      auto indices = read_indices(model_, source_.indices);
      if (!indices.ok()) return fault(std::string(indices.status().message()));
      corners = *std::move(indices);
      for (const std::uint32_t corner : corners) {
        if (corner >= vertices_) {
          return fault(absl::StrCat("accessors[", source_.indices, "]: index ", corner, " of only ",
                                    vertices_, " vertices"));
        }
      }
    }
    out_.primitive.triangles = assemble_triangles(source_.mode, corners);
    if (out_.primitive.triangles.empty()) warn("has no triangles");
    return absl::OkStatus();
  }

  absl::Status read_vectors() {
    absl::Status status;
    if (accessor("NORMAL") != kNone) {
      status = take("NORMAL", read_vec3(model_, accessor("NORMAL")), out_.primitive.normals);
    }
    // Without normals, the specification requires flat shading and ignores tangents.
    if (status.ok() && accessor("TANGENT") != kNone && !out_.primitive.normals.empty()) {
      status = take("TANGENT", read_vec4(model_, accessor("TANGENT")), out_.primitive.tangents);
    }
    return status;
  }

  absl::Status read_uv(const VertexUsage& usage) {
    for (std::size_t set = 0; set < 2; ++set) {
      if (!usage.uv[set]) continue;
      const std::string name = absl::StrCat("TEXCOORD_", set);
      if (accessor(name) == kNone) {
        warn(absl::StrCat("its material reads ", name, ", which is missing; using (0, 0)"));
        out_.primitive.uv[set].assign(vertices_, Vec2f{});
        continue;
      }
      absl::Status status = take(name, read_vec2(model_, accessor(name)), out_.primitive.uv[set]);
      if (!status.ok()) return status;
      for (Vec2f& uv : out_.primitive.uv[set]) {
        if (!std::isfinite(uv.x) || !std::isfinite(uv.y)) return fault(name + " is not finite");
      }
    }
    return absl::OkStatus();
  }

  absl::Status read_colors() {
    const std::int32_t index = accessor("COLOR_0");
    if (index == kNone) return absl::OkStatus();
    const int components = model_.accessors[index].components();
    auto floats = read_floats(model_, index, components == 4 ? 4 : 3);
    if (!floats.ok()) return fault(std::string(floats.status().message()));
    std::vector<Vec4f>& colors = out_.primitive.colors;
    colors.resize(floats->size() / static_cast<std::size_t>(components));
    bool is_clamped = false;
    for (std::size_t i = 0; i < colors.size(); ++i) {
      const float* f = floats->data() + i * static_cast<std::size_t>(components);
      colors[i] = {f[0], f[1], f[2], components == 4 ? f[3] : 1.0f};
      for (int k = 0; k < 4; ++k) {
        if (!std::isfinite(colors[i][k])) return fault("COLOR_0 is not finite");
        const float within = clamp(colors[i][k], 0.0f, 1.0f);  // glTF 2.0, section 3.7.2.1
        is_clamped = is_clamped || within != colors[i][k];
        colors[i][k] = within;
      }
    }
    if (is_clamped) warn("COLOR_0 is outside [0, 1]; clamped");
    return check_count("COLOR_0", colors.size());
  }

  absl::Status read_targets() {
    for (const Attributes& target : source_.targets) {
      BasePrimitive::MorphTarget morph;
      const auto read = [&](const char* name, std::vector<Vec3f>& to) {
        const auto it = target.find(name);
        if (it == target.end()) return absl::OkStatus();
        return take(std::string("targets.") + name, read_vec3(model_, it->second), to);
      };
      absl::Status status = read("POSITION", morph.positions);
      if (status.ok() && !out_.primitive.normals.empty()) status = read("NORMAL", morph.normals);
      if (status.ok() && !out_.primitive.tangents.empty()) status = read("TANGENT", morph.tangents);
      if (!status.ok()) return status;
      out_.targets.push_back(std::move(morph));
    }
    return absl::OkStatus();
  }

  absl::Status read_influences() {
    for (int set = 0;; ++set) {
      const std::int32_t joints = accessor(absl::StrCat("JOINTS_", set));
      const std::int32_t weights = accessor(absl::StrCat("WEIGHTS_", set));
      if (joints == kNone || weights == kNone) return absl::OkStatus();
      BasePrimitive::Influences influences;
      const ComponentType type = model_.accessors[joints].type;
      if (type != ComponentType::u8 && type != ComponentType::u16) {
        return fault(absl::StrCat("JOINTS_", set, " must be unsigned bytes or shorts"));
      }
      std::vector<Vec4f> numbers;
      absl::Status status = take(absl::StrCat("JOINTS_", set), read_vec4(model_, joints), numbers);
      if (status.ok()) {
        status =
            take(absl::StrCat("WEIGHTS_", set), read_vec4(model_, weights), influences.weights);
      }
      if (!status.ok()) return status;
      influences.joints.resize(vertices_);
      for (std::size_t i = 0; i < vertices_; ++i) {
        for (int k = 0; k < 4; ++k) {
          influences.joints[i][static_cast<std::size_t>(k)] =
              static_cast<std::uint16_t>(numbers[i][k]);
        }
      }
      out_.influences.push_back(std::move(influences));
    }
  }

  /// Normalises the normals; those without a direction take that of an adjacent triangle.
  void mend_normals() {
    Primitive& p = out_.primitive;
    std::vector<bool> bad(p.normals.size());
    std::size_t count = 0;
    for (std::size_t i = 0; i < p.normals.size(); ++i) {
      const Vec3f n = is_finite(p.normals[i]) ? normalize(p.normals[i]) : Vec3f{};
      bad[i] = n == Vec3f{};
      if (bad[i]) ++count;
      p.normals[i] = bad[i] ? Vec3f{0, 0, 1} : n;
    }
    if (count == 0) return;
    warn(absl::StrCat(count, " normals are zero or not finite; using face normals"));
    for (const auto& t : p.triangles) {
      const Vec3f n = face_normal(p, t);
      for (const std::uint32_t v : t) {
        if (bad[v] && is_finite(n) && n != Vec3f{}) {
          p.normals[v] = n;
          bad[v] = false;
        }
      }
    }
  }

  /// Normalises the tangents and their signs; drops all of them if one is unusable.
  void mend_tangents() {
    std::vector<Vec4f>& tangents = out_.primitive.tangents;
    for (Vec4f& t : tangents) {
      const Vec3f unit = is_finite(t.xyz()) ? normalize(t.xyz()) : Vec3f{};
      if (unit == Vec3f{}) {
        warn("a tangent is zero or not finite; generating tangents");
        tangents.clear();
        for (auto& target : out_.targets) target.tangents.clear();
        return;
      }
      t = {unit.x, unit.y, unit.z, t.w < 0 ? -1.0f : 1.0f};
    }
  }

  const GltfModel& model_;
  const GltfPrimitive& source_;
  std::string where_;
  std::vector<Problem>& problems_;
  std::size_t vertices_ = 0;
  BasePrimitive out_;
};

}  // namespace

std::size_t drop_invalid_triangles(Primitive& p) {
  const auto wild = [](const Vec3f& v) {
    return !(is_finite(v) && max_abs(v) <= static_cast<float>(kMaxCoordinate));
  };
  std::vector<bool> bad(p.positions.size());
  bool any = false;
  for (std::size_t i = 0; i < bad.size(); ++i) {
    bad[i] = wild(p.positions[i]);
    if (!bad[i]) continue;
    p.positions[i] = {};
    any = true;
  }
  if (!any) return 0;
  const std::size_t before = p.triangles.size();
  std::erase_if(p.triangles, [&](const auto& t) { return bad[t[0]] || bad[t[1]] || bad[t[2]]; });
  return before - p.triangles.size();
}

std::vector<std::array<std::uint32_t, 3>> assemble_triangles(
    PrimitiveMode mode, const std::vector<std::uint32_t>& corners) {
  std::vector<std::array<std::uint32_t, 3>> out;
  const std::size_t n = corners.size();
  if (n < 3) return out;
  if (mode == PrimitiveMode::triangles) {
    out.reserve(n / 3);
    for (std::size_t i = 0; i + 2 < n; i += 3) {
      out.push_back({corners[i], corners[i + 1], corners[i + 2]});
    }
    return out;
  }
  out.reserve(n - 2);
  for (std::size_t i = 0; i + 2 < n; ++i) {
    if (mode == PrimitiveMode::strip) {
      out.push_back({corners[i], corners[i + 1 + i % 2], corners[i + 2 - i % 2]});
    } else {
      out.push_back({corners[i + 1], corners[i + 2], corners[0]});
    }
  }
  return out;
}

absl::StatusOr<std::optional<BasePrimitive>> read_primitive(const GltfModel& model,
                                                            std::int32_t mesh, std::size_t index,
                                                            const VertexUsage& usage,
                                                            std::vector<Problem>& problems) {
  PrimitiveReader reader(model, model.meshes[mesh].primitives[index],
                         absl::StrCat("meshes[", mesh, "].primitives[", index, "]"), problems);
  auto base = reader.read(usage);
  if (base.ok() && *base) (*base)->primitive.id = static_cast<std::int32_t>(index);
  return base;
}

}  // namespace tessera::render
