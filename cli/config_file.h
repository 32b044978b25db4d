#pragma once

#include <CLI/CLI.hpp>
#include <istream>
#include <vector>

namespace tessera::cli {

/// A TOML file with defaults for an app's options. Options on the command line and environment
/// variables take precedence: a default that excludes one of them is ignored, as is one that needs
/// an option without a value.
class ConfigFile : public CLI::ConfigTOML {
 public:
  /// `app` must outlive this object; it has parsed the command line when it reads the file.
  explicit ConfigFile(const CLI::App& app) : app_(app) {}

  /// Throws CLI::ConfigError if a key names no option or a table names no command. The message
  /// names the file, the key and the nearest known name.
  std::vector<CLI::ConfigItem> from_config(std::istream& input) const override;

 private:
  const CLI::App* command_of(const CLI::ConfigItem& item) const;
  const CLI::Option* option_of(const CLI::ConfigItem& item) const;
  void refuse_unknown(const CLI::ConfigItem& item) const;

  const CLI::App& app_;
};

}  // namespace tessera::cli
