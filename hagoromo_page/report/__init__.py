"""Reports: self-contained HTML pages of one look, made from the templates beside the code that fills them."""
