#pragma once

#include <CLI/CLI.hpp>
#include <istream>
#include <vector>

namespace tessera::client {

/// A TOML file of defaults of an app's options. What is typed wins: a default that excludes
/// something typed is left out, and so is one that needs what is neither typed nor a default.
class ConfigFile : public CLI::ConfigTOML {
 public:
  /// `app` has parsed what was typed when it asks for the file, and outlives this.
  explicit ConfigFile(const CLI::App& app) : app_(app) {}

  std::vector<CLI::ConfigItem> from_config(std::istream& input) const override;

 private:
  const CLI::Option* option_of(const CLI::ConfigItem& item) const;

  const CLI::App& app_;
};

}  // namespace tessera::client
