#include "client/manual/pages.h"

#include <CLI/CLI.hpp>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "absl/strings/str_replace.h"
#include "client/cli/shown_options.h"

namespace tessera::client {
namespace {

/// Text as roff shows it unchanged: backslashes, hyphens, and leading dots escaped.
std::string roff_text(const std::string& text) {
  std::string escaped = absl::StrReplaceAll(text, {{"\\", "\\e"}, {"-", "\\-"}});
  escaped = absl::StrReplaceAll(escaped, {{"\n.", "\n\\&."}, {"\n'", "\n\\&'"}});
  return !escaped.empty() && (escaped[0] == '.' || escaped[0] == '\'') ? "\\&" + escaped : escaped;
}

/// Text in a cell of a Markdown table.
std::string cell(const std::string& text) {
  return absl::StrReplaceAll(text, {{"|", "\\|"}, {"\n", " "}, {"<", "&lt;"}});
}

std::string positional_names(const CLI::App& command) {
  std::string names;
  for (const CLI::Option* option : command.get_options()) {
    if (!option->get_positional()) continue;
    const std::string name = option->get_name(true);
    absl::StrAppend(&names, " ", option->get_required() ? name : "[" + name + "]");
  }
  return names;
}

void append_option_rows(const CLI::App& command, std::string& page) {
  for (const CLI::Option* option : command.get_options()) {
    if (!option->get_positional()) continue;
    absl::StrAppend(&page, "| `", option->get_name(true), "` | ", cell(option->get_description()),
                    " | |\n");
  }
  for (const ShownOption& option : shown_options(command)) {
    absl::StrAppend(&page, "| `", absl::StrJoin(option.names, "`, `"),
                    option.value.empty() ? "" : " " + cell(option.value), "` | ",
                    cell(option.description), " | ",
                    option.default_value.empty() ? "" : "`" + option.default_value + "`", " |\n");
  }
}

}  // namespace

std::string man_page(const CLI::App& command, const std::string& program) {
  const std::string name = absl::StrReplaceAll(program, {{" ", "-"}});
  std::string page =
      absl::StrCat(".TH \"", name, "\" 1 \"\" \"tessera\" \"Tessera manual\"\n", ".SH NAME\n",
                   roff_text(name), " \\- ", roff_text(command.get_description()), "\n");
  std::string positionals;
  for (const CLI::Option* option : command.get_options()) {
    if (!option->get_positional()) continue;
    const std::string word = "\\fI" + roff_text(option->get_name(true)) + "\\fR";
    absl::StrAppend(&positionals, " ", option->get_required() ? word : "[" + word + "]");
  }
  absl::StrAppend(&page, ".SH SYNOPSIS\n.B ", roff_text(program), "\n[options]", positionals,
                  shown_subcommands(command).empty() ? "" : " \\fIcommand\\fR", "\n");
  if (!shown_subcommands(command).empty()) {
    absl::StrAppend(&page, ".SH COMMANDS\n");
    for (const CLI::App* each : shown_subcommands(command)) {
      absl::StrAppend(&page, ".TP\n.B ", roff_text(each->get_name()), "\n",
                      roff_text(each->get_description()), "\n");
    }
  }
  absl::StrAppend(&page, ".SH OPTIONS\n");
  for (const CLI::Option* option : command.get_options()) {
    if (!option->get_positional()) continue;
    absl::StrAppend(&page, ".TP\n.I ", roff_text(option->get_name(true)), "\n",
                    roff_text(option->get_description()), "\n");
  }
  for (const ShownOption& option : shown_options(command)) {
    absl::StrAppend(&page, ".TP\n.B ", roff_text(absl::StrJoin(option.names, ", ")),
                    option.value.empty() ? "" : " \\fI" + roff_text(option.value) + "\\fR", "\n",
                    roff_text(option.description),
                    option.default_value.empty()
                        ? ""
                        : absl::StrCat(". Default: ", roff_text(option.default_value)),
                    "\n");
  }
  if (!command.get_footer().empty()) {
    absl::StrAppend(&page, ".SH NOTES\n.nf\n", roff_text(command.get_footer()), "\n.fi\n");
  }
  absl::StrAppend(
      &page,
      ".SH EXIT STATUS\n"
      "0 done; 1 job failed, cancelled or paused by failures, or a comparison over its limit; 2 "
      "wrong usage or bad input; 3 farm unreachable, or request refused; 4 image written, target "
      "error not certified; 130 interrupted.\n");
  return page;
}

std::string man_page_of_help(const std::string& name, const std::string& help) {
  const std::string first_line = help.substr(0, help.find('\n'));
  return absl::StrCat(".TH \"", name, "\" 1 \"\" \"tessera\" \"Tessera manual\"\n.SH NAME\n",
                      roff_text(name), " \\- ", roff_text(first_line), "\n.SH DESCRIPTION\n.nf\n",
                      roff_text(help), "\n.fi\n");
}

std::string markdown_section(const CLI::App& command, const std::string& program) {
  std::string page = absl::StrCat(
      "## ", program, "\n\n", command.get_description(), "\n\n```text\n", program, " [options]",
      positional_names(command), shown_subcommands(command).empty() ? "" : " COMMAND", "\n```\n\n");
  if (!shown_subcommands(command).empty()) {
    absl::StrAppend(&page, "| command | purpose |\n|---|---|\n");
    for (const CLI::App* each : shown_subcommands(command)) {
      absl::StrAppend(&page, "| `", each->get_name(), "` | ", cell(each->get_description()),
                      " |\n");
    }
    absl::StrAppend(&page, "\n");
  }
  absl::StrAppend(&page, "| option | meaning | default |\n|---|---|---|\n");
  append_option_rows(command, page);
  if (!command.get_footer().empty()) {
    absl::StrAppend(&page, "\n```text\n", command.get_footer(), "\n```\n");
  }
  return page + "\n";
}

std::string markdown_section_of_help(const std::string& name, const std::string& help) {
  return absl::StrCat("## ", name, "\n\n```text\n", help, help.ends_with('\n') ? "" : "\n",
                      "```\n\n");
}

}  // namespace tessera::client
