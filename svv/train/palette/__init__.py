"""Stage 2: regions, their colours and the palette colour network (PCN); edits are in :mod:`svv.fields.scene.edits`."""
