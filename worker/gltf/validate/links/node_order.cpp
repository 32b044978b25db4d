#include "worker/gltf/validate/links/linked_document.h"

namespace tessera::render {

namespace {

/// Marks the nodes of loops. Each node has at most one parent, so a walk towards the root that
/// meets itself has found one; nodes of earlier walks need no second visit.
void mark_loops(std::vector<LinkedNode>& nodes) {
  std::vector<std::size_t> walk_of(nodes.size(), 0);
  for (std::size_t start = 0; start < nodes.size(); ++start) {
    std::size_t at = start;
    while (walk_of[at] == 0) {
      walk_of[at] = start + 1;
      if (nodes[at].parent == kNoIndex) break;
      at = static_cast<std::size_t>(nodes[at].parent);
    }
    if (walk_of[at] != start + 1) continue;
    while (nodes[at].parent != kNoIndex && !nodes[at].in_loop) {
      nodes[at].in_loop = true;
      at = static_cast<std::size_t>(nodes[at].parent);
    }
  }
}

/// Gives the nodes of a loop, and those below it, a root in common: one of the loop's nodes.
void set_roots_of_loops(std::vector<LinkedNode>& nodes) {
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    for (std::size_t at = i; nodes[at].in_loop && nodes[at].root == kNoIndex;
         at = static_cast<std::size_t>(nodes[at].parent)) {
      nodes[at].root = static_cast<std::int64_t>(i);
    }
  }
  std::vector<std::size_t> walk;
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    std::size_t at = i;
    for (walk.clear(); nodes[at].root == kNoIndex;
         at = static_cast<std::size_t>(nodes[at].parent)) {
      walk.push_back(at);
    }
    for (const std::size_t below : walk) nodes[below].root = nodes[at].root;
  }
}

}  // namespace

void number_nodes(LinkedDocument& document) {
  std::vector<LinkedNode>& nodes = document.linked_nodes;
  mark_loops(nodes);
  std::vector<std::vector<std::size_t>> children(nodes.size());
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    if (nodes[i].parent != kNoIndex) {
      children[static_cast<std::size_t>(nodes[i].parent)].push_back(i);
    }
  }
  std::size_t clock = 0;
  std::vector<std::pair<std::size_t, std::size_t>> open;  // node, next child
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    if (nodes[i].parent != kNoIndex) continue;
    open.emplace_back(i, 0);
    while (!open.empty()) {
      const std::size_t node = open.back().first;
      std::size_t& next = open.back().second;
      if (next == 0) {
        nodes[node].enter = ++clock;
        nodes[node].root = static_cast<std::int64_t>(i);
      }
      if (next < children[node].size()) {
        open.emplace_back(children[node][next++], 0);
        continue;
      }
      nodes[node].leave = ++clock;
      open.pop_back();
    }
  }
  set_roots_of_loops(nodes);
}

}  // namespace tessera::render
