#pragma once

#include <cstdint>
#include <map>
#include <string>

#include "absl/status/statusor.h"

namespace tessera::server {

/// Kind of the farm's settings; the numbers are stored.
enum class SettingKind : std::int32_t {
  limit = 1,        // units, by limit
  pool = 2,         // pool, by worker that an operator moved
  use = 3,          // CPU seconds that count in fair share, by owner
  aside = 4,        // reason, by worker that an operator set aside
  budget = 5,       // by account
  share = 6,        // weight in fair share, by client
  service_time = 7  // time for which servers have run on this store
};
/// Settings of one kind, by name.
using Settings = std::map<std::string, std::string>;

/// The farm's settings, which operators change while it runs. One thread at a time may save, that
/// of Store; any thread may read.
class SettingsStore {
 public:
  virtual ~SettingsStore() = default;

  /// Replaces all settings of a kind; durable on return.
  virtual absl::Status save(SettingKind kind, const Settings& settings) = 0;
  virtual absl::StatusOr<Settings> read(SettingKind kind) const = 0;
};

}  // namespace tessera::server
