#include "cli/help_text.h"

#include <gtest/gtest.h>

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

namespace tessera::cli {
namespace {

/// An option of each kind, and commands of commands.
class HelpText : public testing::Test {
 protected:
  HelpText() {
    app.formatter(help_formatter());
    app.add_option("scene", text, "Scene file")->required();
    spp = app.add_option("--spp", number, "Samples")->check(CLI::Range(1, 1 << 20));
    spp->capture_default_str();
    app.add_option("--error", fraction, "Target error (default: none)")
        ->check(CLI::Range(1e-6, 1e9))
        ->excludes(spp);
    app.add_option("--max-spp", number, "With --error: most samples")->needs("--error");
    app.add_option("--level", text, "Level")->check(CLI::IsMember({"warn", "stop"}))->required();
    app.add_option("--events", list, "Events")
        ->check(CLI::IsMember(
            std::vector<std::string>{"job submitted", "job running", "job paused", "job done"}));
    app.add_option("--size", text, "Size")->check(CLI::Validator(ignored, "WxH"));
    app.add_option("--keys", list, "Keys")->delimiter(',')->type_name("NAME:KEY=VALUE,...");
    app.add_option("--server", text, "Address (or SERVER)")->envname("SERVER");
    app.add_option("--token", text, "Token")->envname("TOKEN");
    app.add_flag("--json", is_json, "JSON output");
  }
  static std::string ignored(std::string& /*text*/) { return ""; }
  std::string described(const std::string& name) const {
    return option_text(*app.get_option(name)).description;
  }
  std::string value(const std::string& name) const {
    return option_text(*app.get_option(name)).value;
  }

  CLI::App app;
  CLI::Option* spp = nullptr;
  bool is_json = false;
  int number = 64;
  double fraction = 0;
  std::string text;
  std::vector<std::string> list;
};

TEST_F(HelpText, ValuesHaveNamesOrChoices) {
  EXPECT_EQ(value("--spp"), "N");
  EXPECT_EQ(value("--level"), "warn|stop");
  EXPECT_EQ(value("--events"), "TEXT") << "the choices are too long for the column";
  EXPECT_EQ(value("--size"), "WxH");
  EXPECT_EQ(value("--keys"), "NAME:KEY=VALUE,...");
  EXPECT_EQ(value("--json"), "");
}

TEST_F(HelpText, ConditionsFollowDescription) {
  EXPECT_EQ(described("--spp"), "Samples (1 to 1048576; not with --error)");
  EXPECT_EQ(described("--error"), "Target error (default: none; 1e-6 to 1e9; not with --spp)");
  EXPECT_EQ(described("--max-spp"), "With --error: most samples") << "the need is said already";
  EXPECT_EQ(described("--level"), "Level (required)");
  EXPECT_EQ(described("--events"),
            "Events (one of: job submitted, job running, job paused, job done; repeatable)");
  EXPECT_EQ(described("--keys"), "Keys") << "a list after one comma";
  EXPECT_EQ(described("--server"), "Address (or SERVER)");
  EXPECT_EQ(described("--token"), "Token (environment variable: TOKEN)");
  EXPECT_EQ(described("scene"), "Scene file") << "the usage shows that it is required";
}

TEST_F(HelpText, LinesHaveDefaultsAndNoTypeNames) {
  const std::string help = app.help();
  EXPECT_NE(help.find("  --spp N                     Samples (1 to 1048576; not with --error; "
                      "default: 64)\n"),
            std::string::npos)
      << help;
  for (const char* type : {"INT", "FLOAT", "REQUIRED", "Excludes"}) {
    EXPECT_EQ(help.find(type), std::string::npos) << help;
  }
}

TEST_F(HelpText, HelpAllIncludesCommandsOfCommands) {
  app.set_help_all_flag("--help-all");
  CLI::App* const inner = app.add_subcommand("tokens", "Tokens")->add_subcommand("create", "New");
  inner->add_option("--ttl", number, "Seconds");
  const std::string help = app.help("", CLI::AppFormatMode::All);
  EXPECT_NE(help.find("  create\n    New\n"), std::string::npos) << help;
  EXPECT_NE(help.find("--ttl N"), std::string::npos) << help;
}

}  // namespace
}  // namespace tessera::cli
