#pragma once

#include "server/store/farm/settings_store.h"
#include "server/store/sqlite/journal.h"

namespace tessera::server {

/// Settings of the farm as rows of the journal.
class SettingsRows final : public SettingsStore {
 public:
  explicit SettingsRows(Journal& journal) : journal_(journal) {}

  absl::Status save(SettingKind kind, const Settings& settings) override;
  absl::StatusOr<Settings> read(SettingKind kind) const override;

 private:
  Journal& journal_;
};

}  // namespace tessera::server
