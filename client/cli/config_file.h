#pragma once

#include <CLI/CLI.hpp>
#include <istream>
#include <vector>

namespace tessera::client {

/// A TOML file with defaults for an app's options. Options on the command line and environment
/// variables take precedence: a default that excludes one of them is ignored, as is one that needs
/// an option without a value.
class ConfigFile : public CLI::ConfigTOML {
 public:
  /// `app` must outlive this object; it has parsed the command line when it reads the file.
  explicit ConfigFile(const CLI::App& app) : app_(app) {}

  std::vector<CLI::ConfigItem> from_config(std::istream& input) const override;

 private:
  const CLI::Option* option_of(const CLI::ConfigItem& item) const;

  const CLI::App& app_;
};

}  // namespace tessera::client
