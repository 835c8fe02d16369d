"""Archive: results in the form that museums and libraries keep: a bag (BagIt) with Dublin Core and RO-Crate."""
