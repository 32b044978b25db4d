#include "worker/gltf/animation/animation.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <utility>

#include "absl/strings/str_cat.h"
#include "worker/gltf/animation/selection.h"
#include "worker/gltf/decode/accessor_reader.h"
#include "worker/gltf/file/limits.h"
#include "worker/math/elementary.h"

namespace tessera::render {

namespace {

/// Keys of a channel.
struct Track {
  std::vector<float> times;
  std::vector<float> values;  // `width` per key, three times that for cubic splines
  int width = 0;
  Interpolation interpolation = Interpolation::linear;
};

/// Number of morph targets of the mesh that a weights channel animates.
int target_count(const GltfModel& model, std::int32_t node) {
  const std::int32_t mesh = model.nodes[node].mesh;
  if (mesh == kNone || model.meshes[mesh].primitives.empty()) return 0;
  return static_cast<int>(model.meshes[mesh].primitives.front().targets.size());
}

/// Number of values per key.
int track_width(const GltfModel& model, const AnimationChannel& channel) {
  if (channel.path == AnimationPath::weights) return target_count(model, channel.node);
  return channel.path == AnimationPath::rotation ? 4 : 3;
}

/// Required number of elements of the output accessor.
std::int64_t output_count(const GltfModel& model, const AnimationChannel& channel) {
  const bool cubic = channel.interpolation == Interpolation::cubic_spline;
  const bool weights = channel.path == AnimationPath::weights;
  return model.accessors[channel.input].count * (cubic ? 3 : 1) *
         (weights ? target_count(model, channel.node) : 1);
}

bool all_finite(const std::vector<float>& values) {
  return std::all_of(values.begin(), values.end(), [](float v) { return std::isfinite(v); });
}

/// Layout of a channel's accessors.
struct TrackLayout {
  std::int32_t input, output;  // accessors
  Interpolation interpolation;
  int width;          // values per key
  bool flat = false;  // values are separate scalars in the output, not one element
};

TrackLayout layout_of(const GltfModel& model, const AnimationChannel& channel) {
  return {channel.input, channel.output, channel.interpolation, track_width(model, channel),
          channel.path == AnimationPath::weights};
}

TrackLayout layout_of(const PointerChannel& channel) {
  return {channel.input, channel.output, channel.interpolation, channel.width, channel.flat};
}

absl::StatusOr<Track> read_track(const GltfModel& model, const TrackLayout& channel,
                                 const std::string& where) {
  const auto fault = [&](const std::string& message) {
    return absl::InvalidArgumentError(absl::StrCat(where, ": ", message));
  };
  Track track;
  track.interpolation = channel.interpolation;
  auto times = read_floats(model, channel.input, 1);
  if (!times.ok()) return times.status();
  track.times = *std::move(times);
  track.width = channel.width;
  auto values = read_floats(model, channel.output, channel.flat ? 1 : track.width);
  if (!values.ok()) return values.status();
  track.values = *std::move(values);
  const std::size_t per_key = static_cast<std::size_t>(track.width) *
                              (channel.interpolation == Interpolation::cubic_spline ? 3 : 1);
  if (track.values.size() != track.times.size() * per_key) {
    return fault(absl::StrCat("output has ", track.values.size(), " numbers, expected ",
                              track.times.size() * per_key));
  }
  if (!all_finite(track.values) || !all_finite(track.times))
    return fault("contains NaN or infinity");
  for (std::size_t i = 1; i < track.times.size(); ++i) {
    if (!(track.times[i] > track.times[i - 1])) return fault("key times do not increase");
  }
  return track;
}

/// Value of the track at time t. `spherical`: the four values are a quaternion.
std::vector<double> evaluate(const Track& track, double t, bool spherical) {
  const auto width = static_cast<std::size_t>(track.width);
  const bool cubic = track.interpolation == Interpolation::cubic_spline;
  const std::size_t per_key = width * (cubic ? 3 : 1);
  const std::size_t middle = cubic ? width : 0;
  const std::size_t last = track.times.size() - 1;
  const auto value = [&](std::size_t key, std::size_t k) {
    return static_cast<double>(track.values[key * per_key + k]);
  };
  // The last key at or before t; times outside the keys use the end keys.
  const auto after =
      std::upper_bound(track.times.begin(), track.times.end(), t,
                       [](double x, float key) { return x < static_cast<double>(key); });
  const auto index = static_cast<std::size_t>(after - track.times.begin());
  const std::size_t key = index == 0 ? 0 : index - 1;
  std::vector<double> out(width);
  if (index == 0 || key == last || track.interpolation == Interpolation::step) {
    for (std::size_t k = 0; k < width; ++k) out[k] = value(key, middle + k);
    return out;
  }
  const double begin = track.times[key], span = track.times[key + 1] - begin;
  const double f = (t - begin) / span;
  if (!cubic && spherical) {
    const Vec4d q =
        slerp({value(key, 0), value(key, 1), value(key, 2), value(key, 3)},
              {value(key + 1, 0), value(key + 1, 1), value(key + 1, 2), value(key + 1, 3)}, f);
    return {q.x, q.y, q.z, q.w};
  }
  const double f2 = f * f, f3 = f2 * f;
  for (std::size_t k = 0; k < width; ++k) {
    const double a = value(key, middle + k), b = value(key + 1, middle + k);
    const double out_tangent = cubic ? value(key, 2 * width + k) * span : 0;
    const double in_tangent = cubic ? value(key + 1, k) * span : 0;
    out[k] = cubic ? (2 * f3 - 3 * f2 + 1) * a + (f3 - 2 * f2 + f) * out_tangent +
                         (3 * f2 - 2 * f3) * b + (f3 - f2) * in_tangent
                   : a + f * (b - a);
  }
  return out;
}

std::string channel_path(std::int32_t animation, std::size_t channel) {
  return absl::StrCat("animations[", animation, "].channels[", channel, "]");
}

class AnimationChecker {
 public:
  explicit AnimationChecker(const GltfModel& model) : model_(model) {}

  absl::Status check(std::int32_t animation) {
    const auto& channels = model_.animations[animation].channels;
    for (std::size_t k = 0; k < channels.size(); ++k) {
      absl::Status status = check(channels[k], channel_path(animation, k));
      if (!status.ok()) return status;
    }
    for (const PointerChannel& c : model_.animations[animation].pointers) {
      absl::Status status = check_accessor_faults(c.input, c.output);
      if (status.ok()) status = pointer_values(model_, animation, c, 0).status();
      if (!status.ok()) return status;
    }
    return absl::OkStatus();
  }

 private:
  absl::Status check(const AnimationChannel& c, const std::string& where) {
    absl::Status valid = check_accessor_faults(c.input, c.output);
    if (!valid.ok()) return valid;
    const int width = track_width(model_, c);
    const bool weights = c.path == AnimationPath::weights;
    bytes_ += decoded_bytes(model_, c.input) + decoded_bytes(model_, c.output);
    if (bytes_ > kMaxGeometryBytes) {
      return absl::InvalidArgumentError(
          absl::StrCat(where, ": the tracks take more than ", kMaxGeometryBytes, " bytes"));
    }
    const auto input = std::make_pair(c.input, 0);
    const auto output = std::make_pair(c.output, weights ? -width : width);
    // Channels share accessors; each pair of them is read once.
    if (checked_.contains(input) && checked_.contains(output) &&
        model_.accessors[c.output].count == output_count(model_, c)) {
      return absl::OkStatus();
    }
    const auto track = read_track(model_, layout_of(model_, c), where);
    if (!track.ok()) return track.status();
    checked_.insert(input);
    checked_.insert(output);
    return absl::OkStatus();
  }

  absl::Status check_accessor_faults(std::int32_t input, std::int32_t output) const {
    for (const std::int32_t accessor : {input, output}) {
      const absl::Status* fault = model_.faults.find("accessors", accessor);
      if (fault != nullptr) return *fault;
    }
    return absl::OkStatus();
  }

  const GltfModel& model_;
  std::set<std::pair<std::int32_t, std::int32_t>> checked_;  // accessor, components
  std::uint64_t bytes_ = 0;
};

}  // namespace

Vec4d slerp(const Vec4d& a, Vec4d b, double f) {
  if (a.x * b.x + a.y * b.y + a.z * b.z + a.w * b.w < 0) b = b * -1.0;
  const Vec4d difference = b - a, sum = a + b;
  const auto norm = [](const Vec4d& v) {
    return std::sqrt(v.x * v.x + v.y * v.y + v.z * v.z + v.w * v.w);
  };
  // Accurate for small angles, unlike acos of the dot product. Source: Kahan.
  const double angle = 2 * elementary::atan2(norm(difference), norm(sum));
  const double sine = elementary::sin(angle);
  if (!(sine > 0)) return a + difference * f;
  return a * (elementary::sin((1 - f) * angle) / sine) + b * (elementary::sin(f * angle) / sine);
}

absl::StatusOr<std::vector<std::int32_t>> choose_animations(const GltfModel& model,
                                                            const std::string& selection) {
  std::vector<std::int32_t> chosen;
  if (selection == "none" || (selection.empty() && model.animations.empty())) return chosen;
  if (selection.empty()) return std::vector<std::int32_t>{0};
  std::vector<std::string> names;
  for (const Animation& a : model.animations) names.push_back(a.name);
  if (selection == "all" && std::find(names.begin(), names.end(), "all") == names.end()) {
    for (std::size_t i = 0; i < names.size(); ++i) chosen.push_back(static_cast<std::int32_t>(i));
    return chosen;
  }
  const auto index = choose(names, selection, "animation");
  if (!index.ok()) return index.status();
  chosen.push_back(*index);
  return chosen;
}

double clip_seconds(const GltfModel& model, std::int32_t animation) {
  double last = 0;
  const auto lengthen = [&](std::int32_t input) {
    const auto times = read_floats(model, input, 1);
    if (times.ok() && !times->empty() && times->back() > last) last = times->back();
  };
  for (const AnimationChannel& channel : model.animations[animation].channels) {
    lengthen(channel.input);
  }
  for (const PointerChannel& channel : model.animations[animation].pointers) {
    lengthen(channel.input);
  }
  return last;
}

std::vector<AnimationKey> animation_keys(const GltfModel& model,
                                         const std::vector<std::int32_t>& animations, double from,
                                         double to) {
  std::map<double, bool> keys;                   // whether the value jumps there
  std::set<std::pair<std::int32_t, bool>> read;  // already read: channels share accessors
  for (const std::int32_t animation : animations) {
    for (const AnimationChannel& channel : model.animations[animation].channels) {
      const bool jumps = channel.interpolation == Interpolation::step;
      if (!read.insert({channel.input, jumps}).second) continue;
      const auto times = read_floats(model, channel.input, 1);
      if (!times.ok()) continue;
      for (const float time : *times) {
        const auto seconds = static_cast<double>(time);
        if (!(seconds > from && seconds < to)) continue;
        bool& known = keys[seconds];
        known = known || jumps;
      }
    }
  }
  std::vector<AnimationKey> out;
  out.reserve(keys.size());
  for (const auto& [seconds, jumps] : keys) out.push_back({seconds, jumps});
  return out;
}

void check_animations(GltfModel& model) {
  AnimationChecker checker(model);
  for (std::size_t i = 0; i < model.animations.size(); ++i) {
    const auto index = static_cast<std::int32_t>(i);
    const std::string where = absl::StrCat("animations[", i, "]");
    const absl::Status status = checker.check(index);
    if (!status.ok()) model.faults.add(where, status);
    if (model.faults.find("animations", index) != nullptr) {
      model.animations[i].channels.clear();
      model.animations[i].pointers.clear();
    }
  }
}

absl::Status animate(const GltfModel& model, std::int32_t animation, double seconds,
                     std::vector<Node>& nodes) {
  const auto& channels = model.animations[animation].channels;
  for (std::size_t k = 0; k < channels.size(); ++k) {
    const AnimationChannel& channel = channels[k];
    const auto track = read_track(model, layout_of(model, channel), channel_path(animation, k));
    if (!track.ok()) return track.status();
    Node& node = nodes[channel.node];
    const bool rotation = channel.path == AnimationPath::rotation;
    const std::vector<double> v = evaluate(*track, seconds, rotation);
    if (channel.path != AnimationPath::weights) node.matrix.reset();
    if (channel.path == AnimationPath::translation) node.translation = {v[0], v[1], v[2]};
    if (channel.path == AnimationPath::scale) node.scale = {v[0], v[1], v[2]};
    if (rotation) node.rotation = {v[0], v[1], v[2], v[3]};
    if (channel.path == AnimationPath::weights) node.weights = v;
  }
  return absl::OkStatus();
}

absl::StatusOr<std::vector<double>> pointer_values(const GltfModel& model, std::int32_t animation,
                                                   const PointerChannel& channel, double seconds) {
  const auto track = read_track(model, layout_of(channel), channel_path(animation, channel.index));
  if (!track.ok()) return track.status();
  if (track->times.empty()) {
    return absl::InvalidArgumentError(
        absl::StrCat(channel_path(animation, channel.index), ": has no keys"));
  }
  return evaluate(*track, seconds, false);
}

}  // namespace tessera::render
