# Sources and headers of worker/shading: target_sources(tessera_render PRIVATE … PUBLIC FILE_SET HEADERS …).
